"""Puts programs that lie in `programs/` into the wheel, as commands, and says what they run on."""

import os
import pathlib

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Programs(BuildHookInterface):
    def initialize(self, version, build_data):
        folder = pathlib.Path(self.root) / "programs"
        if not folder.is_dir():
            return
        for program in sorted(folder.iterdir()):
            build_data["shared_scripts"][str(program)] = program.name
        build_data["pure_python"] = False
        build_data["tag"] = "py3-none-" + os.environ["HALTERE_WHEEL_PLATFORM"]
