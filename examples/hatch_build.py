"""Puts the map of modes into the wheel, and programs that lie in `programs/` as commands, and says what they run on."""

import contextlib
import importlib.util
import os
import pathlib

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Programs(BuildHookInterface):
    def initialize(self, version, build_data):
        # pip builds in the sources: what Python made of this file is not left there.
        compiled = pathlib.Path(importlib.util.cache_from_source(__file__))
        compiled.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            compiled.parent.rmdir()
        root = pathlib.Path(self.root)
        name = "custom_mode_map.json"
        # In the repository it lies where docs/STATIONS.md tells people to take it from.
        for folder in (root, root.parent / "stations"):
            if (folder / name).exists():
                build_data["force_include"][str(folder / name)] = f"haltere_testing/{name}"
        folder = root / "programs"
        if not folder.is_dir():
            return
        for program in sorted(folder.iterdir()):
            build_data["shared_scripts"][str(program)] = program.name
        build_data["pure_python"] = False
        build_data["tag"] = "py3-none-" + os.environ["HALTERE_WHEEL_PLATFORM"]
