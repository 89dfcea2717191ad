# sbom.sh SOURCE BUILD: scripts/sbom prints JSON, twice the same, that lists what the programs are made of.
set -euo pipefail
command -v python3 > /dev/null || exit 77
[[ -x $2/bin/svinfo ]] || exit 77  # only some layers are built
first=$("$1"/scripts/sbom "$2")
[[ $first == "$("$1"/scripts/sbom "$2")" ]]
python3 -c '
import json, sys
bom = json.load(sys.stdin)
assert bom["bomFormat"] == "CycloneDX", bom
versions = {part["name"]: part["version"] for part in bom["components"]}
for name in ["fonts-dejavu-core", "libc6", "libtbb12", "libzstd1"]:
    assert versions.get(name), f"{name} is not in {sorted(versions)}"
' <<< "$first"
