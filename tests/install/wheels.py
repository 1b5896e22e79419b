"""Checks wheels: required symbols of the C library, the licences in them, and the links of their descriptions.

python3 wheels.py WHEEL...
"""

import re
import sys
import zipfile

# manylinux_2_28.
NEWEST_GLIBC = (2, 28)
# Values of e_machine in ELF files.
MACHINES = {"x86_64": 62, "aarch64": 183}

for path in sys.argv[1:]:
    wheel = zipfile.ZipFile(path)
    names = wheel.namelist()
    assert not any("/sboms/" in name for name in names), (
        f"{path} has a list of parts, with paths of the machine that built it"
    )
    [library] = [name for name in names if name.endswith(".so")]
    binary = wheel.read(library)
    [machine] = [machine for machine in MACHINES if path.endswith(f"-abi3-manylinux_2_28_{machine}.whl")]
    assert int.from_bytes(binary[18:20], "little") == MACHINES[machine], f"{path}: {library} is for another machine"
    versions = {tuple(map(int, version.split(b"."))) for version in re.findall(rb"GLIBC_(\d+\.\d+)", binary)}
    assert versions and max(versions) <= NEWEST_GLIBC, (
        f"{path}: {library} needs GLIBC_{max(versions)}, above {NEWEST_GLIBC}"
    )

    [metadata] = [wheel.read(name).decode() for name in names if name.endswith(".dist-info/METADATA")]
    for licence in ["LICENSE-APACHE", "LICENSE-MIT", "LICENSE-OF-OTHERS.txt"]:
        assert f"License-File: {licence}\n" in metadata, f"{path}: its metadata has no {licence}"
        [text] = [wheel.read(name) for name in names if name.endswith(f".dist-info/licenses/{licence}")]
        assert len(text) > 1000, f"{path}: {licence} has {len(text)} bytes"
    assert b"pyo3" in text and b"nalgebra" in text, f"{path}: {licence} lacks crates that are linked in"
    links = re.findall(r"\]\(([^)]*)\)", metadata)
    relative = [link for link in links if not link.startswith("https://")]
    assert not relative, f"{path}: links lead nowhere from outside: {relative}"
    print(f"{path}: GLIBC_{'.'.join(map(str, max(versions)))}, {len(links)} links, licences")
