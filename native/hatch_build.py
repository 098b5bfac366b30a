"""The package's build hook: the extension goes into a wheel; an editable installation finds it in tracker/."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class NativeHook(BuildHookInterface):
    """Builds `tracker._native` for the wheel or the checkout."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before it collects files."""
        building = runpy.run_path(str(Path(self.root) / "native" / "build.py"))
        if version == "editable":
            building["build_in_place"]()
        else:
            built = building["build"]()
            build_data["force_include"][str(built)] = f"tracker/{built.name}"
            build_data["tag"] = self._tag(stable=building["is_stable"](built))
        build_data["pure_python"] = False

    def _tag(self, *, stable: bool) -> str:
        """Which Python and machines the wheel is for; one extension of the stable ABI serves all Python from 3.12."""
        tag: str = self.build_config.builder.get_best_matching_tag()
        return f"cp312-abi3-{tag.split('-')[2]}" if stable else tag
