"""The bench file to connect with to live simulators: that of the bench, with their ports and without its simulation."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from bench.benchfile import DECLARATION_SUFFIXES, Bench, Instrument
from bench.yamlfile import Path_


class _Dumper(yaml.SafeDumper):
    """Writes what bench.yamlfile reads: no aliases, and quotes around text that YAML 1.2 takes for a number."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


# YAML 1.1, which pyyaml writes for, wants a dot in a float; 1.2 does not.
_Dumper.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[+-]?[0-9]+[eE][+-]?[0-9]+"), list("+-0123456789")
)


def live_file(bench: Bench, ports: Mapping[Path_, Any], speed: float) -> str:
    """The text of the bench file: same settings and limits, other ports, `clock:` if the speed is not 1.

    ports: what stands under `port:` of the instrument at each path. Files that settings name get their whole path, so
    that the text may be put into any folder.
    """
    given = copy.deepcopy(bench.document.data)
    name = Path(bench.document.file).name
    live: dict[str, Any] = {"bench": given["bench"], "description": f"Live simulators of {name}; not hardware."}
    if speed != 1.0:
        live["clock"] = {"speed": speed}
    live |= {key: value for key, value in given.items() if key not in ("bench", "description", "clock", "simulation")}
    for item in bench.instruments:
        entry: Any = live
        for part in item.path:
            entry = entry[part]
        entry["port"] = ports[item.path]
        # A simulator answers for its kind, not for the instrument on the bench.
        entry.pop("identity", None)
        entry |= {"settings": _anywhere(item, entry["settings"])} if entry.get("settings") else {}
    return yaml.dump(live, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)


def _anywhere(item: Instrument, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings whose files are found from any folder."""

    def whole(key: str, value: Any) -> Any:
        if not isinstance(value, str) or Path(value).suffix not in DECLARATION_SUFFIXES:
            return value
        # A setting that is text has no unit: its field has the same name, and the path as found beside the bench file.
        found = Path(getattr(item.settings, key))
        return str(found.resolve()) if found.is_file() else value

    return {key: whole(key, value) for key, value in settings.items()}
