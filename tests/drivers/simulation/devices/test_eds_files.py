from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary import ODVariable

EDS = Path(__file__).parents[4] / "config" / "eds"
FILES = ("cia402_drive.eds", "cia404_load_cell.eds")


@pytest.mark.parametrize(("file", "device_type"), [(FILES[0], 0x00020192), (FILES[1], 0x00020194)])
def test_identity(file, device_type):
    dictionary = canopen.import_od(str(EDS / file), 7)
    assert dictionary[0x1000].default == device_type
    assert dictionary[0x1014].default == 0x087
    assert dictionary[0x1200][1].default == 0x607
    assert dictionary[0x1800][1].default & 0x7FF == 0x187
    assert 1_000_000 in dictionary.device_information.allowed_baudrates


@pytest.mark.parametrize("file", FILES)
def test_lists_of_objects_are_complete(file):
    text = (EDS / file).read_text(encoding="ascii")
    listed = set()
    for block in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        lines = text.split(f"[{block}]\n")[1].split("\n\n")[0].splitlines()
        count = int(lines[0].removeprefix("SupportedObjects="))
        assert len(lines) == count + 1
        listed |= {int(line.split("=")[1], 16) for line in lines[1:]}
    assert listed == set(canopen.import_od(str(EDS / file), 1))


@pytest.mark.parametrize("file", FILES)
def test_sub_numbers_and_defaults(file):
    text = (EDS / file).read_text(encoding="ascii")
    dictionary = canopen.import_od(str(EDS / file), 1)
    for entry in dictionary.values():
        if isinstance(entry, ODVariable):
            continue
        section = text.split(f"[{entry.index:04X}]\n")[1].split("\n\n")[0]
        assert f"SubNumber={len(entry)}" in section
        for variable in entry.values():
            assert variable.access_type in ("const", "ro", "rw", "wo", "rww"), f"{variable}"
            if variable.default is not None:
                assert variable.decode_raw(variable.encode_raw(variable.default)) == variable.default


@pytest.mark.parametrize("file", FILES)
def test_default_mappings_name_objects_that_can_be_mapped(file):
    dictionary = canopen.import_od(str(EDS / file), 1)
    for index in [index for index in dictionary if index & 0xFDFC in (0x1600, 0x1800 | 0x200 & 0x1A00)]:
        bits = 0
        for subindex in range(1, dictionary[index][0].default + 1):
            mapping = dictionary[index][subindex].default
            entry = dictionary[mapping >> 16]
            if not isinstance(entry, ODVariable):
                entry = entry[mapping >> 8 & 0xFF]
            assert entry.pdo_mappable
            assert len(entry) == mapping & 0xFF
            bits += mapping & 0xFF
        assert bits <= 64


def test_drive_offers_cyclic_synchronous_torque():
    dictionary = canopen.import_od(str(EDS / FILES[0]), 1)
    assert dictionary[0x6502].default == 1 << 9
