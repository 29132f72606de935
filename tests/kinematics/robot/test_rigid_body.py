from __future__ import annotations

import numpy as np
import pytest

from cspr_kinematics import InvalidInputError, Payload, RigidBody


def test_moments_about_the_origin_add_up(rng: np.random.Generator) -> None:
    body = RigidBody(150.0, rng.normal(size=3), np.diag([2.0, 2.5, 3.0]))
    payload = Payload(70.0, rng.normal(size=3))
    both = RigidBody.from_inertial_parameters(body.inertial_parameters + payload.inertial_parameters)
    assert both.mass == 220.0
    np.testing.assert_allclose(both.first_moment, body.first_moment + payload.first_moment)
    np.testing.assert_allclose(
        both.inertia_about_origin, body.inertia_about_origin + payload.inertia_about_origin
    )


def test_a_payload_of_no_mass_has_no_inertial_parameters() -> None:
    assert not Payload.none().inertial_parameters.any()


def test_inertia_of_two_point_masses_about_their_middle() -> None:
    tiny = RigidBody(3.0, [0.0, 0.0, 0.0], 1e-9 * np.eye(3))
    parameters = tiny.inertial_parameters + Payload(3.0, [2.0, 0.0, 0.0]).inertial_parameters
    both = RigidBody.from_inertial_parameters(parameters)
    np.testing.assert_allclose(both.center_of_mass, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(both.inertia, np.diag([0.0, 6.0, 6.0]), atol=1e-8)


@pytest.mark.parametrize("parameters", [np.zeros(9), np.zeros(10), np.ones((2, 10)), np.full(10, np.nan)])
def test_parameters_no_body_can_have_are_refused(parameters: np.ndarray) -> None:
    with pytest.raises(InvalidInputError):
        RigidBody.from_inertial_parameters(parameters)


@pytest.mark.parametrize(
    ("inertia", "reason"),
    [
        ([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "not symmetric"),
        (np.diag([1.0, 1.0, 0.0]), "not all positive"),
        (np.diag([1.0, 1.0, -1.0]), "not all positive"),
        (np.diag([1.0, 1.0, 2.1]), "add up to less than the third"),
        (np.diag([1.0, np.nan, 1.0]), "not finite"),
        (np.ones(3), "shape"),
        (np.ones((2, 3, 3)), "shape"),
    ],
)
def test_an_inertia_no_body_can_have_is_refused(inertia: object, reason: str) -> None:
    with pytest.raises(InvalidInputError, match=reason) as caught:
        RigidBody(1.0, np.zeros(3), inertia)
    assert caught.value.name == "inertia"


def test_a_flat_plate_is_a_body() -> None:
    RigidBody(1.0, np.zeros(3), np.diag([1.0, 1.0, 2.0]))


@pytest.mark.parametrize("mass", [0.0, -1.0, np.nan, np.inf, "heavy"])
def test_a_body_needs_a_positive_mass(mass: float) -> None:
    with pytest.raises(InvalidInputError, match="mass"):
        RigidBody(mass, np.zeros(3), np.eye(3))


@pytest.mark.parametrize("mass", [-1e-9, np.nan, -np.inf])
def test_a_payload_has_no_negative_mass(mass: float) -> None:
    with pytest.raises(InvalidInputError, match="payload mass") as caught:
        Payload(mass, np.zeros(3))
    assert caught.value.value is mass


def test_a_payload_has_one_finite_place() -> None:
    with pytest.raises(InvalidInputError, match="center_of_mass"):
        Payload(1.0, [0.0, np.nan, 0.0])
    with pytest.raises(InvalidInputError, match="center_of_mass"):
        Payload(1.0, np.zeros((2, 3)))
