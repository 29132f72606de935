"""The words that the packages have in common."""

import pytest

from cspr_msgs_py.vocabulary import Controller, FeedforwardModel, PayloadSource, RobotState, controller_label


@pytest.mark.parametrize("controller", Controller)
def test_controller_from_its_settings(controller: Controller) -> None:
    assert Controller.of(controller.model, controller.payload_source) is controller


def test_controller_of_any_payload() -> None:
    assert Controller.of(FeedforwardModel.STATIC, PayloadSource.ESTIMATED) is Controller.STATIC
    assert Controller.of(FeedforwardModel.NONE, PayloadSource.ESTIMATED) is Controller.PD
    assert Controller.of("dynamic", "") is Controller.PDFF
    assert Controller.of("", "estimated") is None


def test_words_are_their_own_texts() -> None:
    assert f"{RobotState.FAULT}" == "fault" == RobotState.FAULT
    assert controller_label(Controller.PDFF, exact_mass=True) == "pdff (exact mass)"
