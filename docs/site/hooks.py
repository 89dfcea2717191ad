"""What MkDocs does besides: pages of the navigation that are not written yet are left out, and named."""

from pathlib import Path

# Pages that a part of the project adds. Any other page that is missing ends the build.
MAY_BE_MISSING = {"docs/install.md", "docs/library.md", "docs/python.md"}


def keep(entry, folder: Path) -> bool:
    path = next(iter(entry.values())) if isinstance(entry, dict) else entry
    if isinstance(path, list):
        path[:] = [inner for inner in path if keep(inner, folder)]
        return bool(path)
    if path not in MAY_BE_MISSING or (folder / path).is_file():
        return True
    print(f"docs: no {path} yet: the site is built without it")
    return False


def on_config(config):
    config.nav[:] = [entry for entry in config.nav if keep(entry, Path(config.docs_dir))]
    return config
