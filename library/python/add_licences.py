"""add_licences.py WHEEL: adds the licences of the system's libraries that the module needs, before auditwheel puts
these into the wheel and lists all of its files.

Debian keeps the licences of each package in /usr/share/doc/PACKAGE/copyright.
"""

import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

# Packages of the libraries that auditwheel leaves to the system.
OF_THE_SYSTEM = {"libc6", "libgcc-s1", "libstdc++6"}


def libraries_of(module):
    """Returns the paths of the libraries that a module loads."""
    told = subprocess.run(["ldd", module], capture_output=True, text=True, check=True).stdout
    return re.findall(r" => (/\S+)", told)


def package_of(library):
    path = str(Path(library).resolve())
    # Where /lib is a link to /usr/lib, packages name either.
    for name in (path, path.removeprefix("/usr")):
        told = subprocess.run(["dpkg", "--search", name], capture_output=True, text=True)
        if told.returncode == 0:
            return told.stdout.split(":")[0]
    sys.exit(f"add_licences: no package has {path}")


def main(path):
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as wheel, tempfile.TemporaryDirectory() as folder:
        module = next(name for name in wheel.namelist() if name.startswith("splatvol/_core.") and name.endswith(".so"))
        information = next(name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
        packages = {package_of(library) for library in libraries_of(wheel.extract(module, folder))}
        for package in sorted(packages - OF_THE_SYSTEM):
            text = Path("/usr/share/doc", package, "copyright").read_bytes()
            wheel.writestr(information.replace("METADATA", f"licenses/libraries/{package}.txt"), text)


if __name__ == "__main__":
    main(sys.argv[1])
