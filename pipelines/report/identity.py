"""The section on identity: which tyre, under which conditions, tested by whom, from which files."""

from __future__ import annotations

from collections.abc import Mapping

from pipelines.report.blocks import Facts, Section
from pipelines.result import Result

CHECKSUM_DIGITS = 12  # enough to compare by eye; the whole ones stand with software and inputs
MOST_FILES = 8
# What a lab writes down, in the order of a test report: key in [tyre] → name and unit.
KNOWN = {
    "manufacturer": ("Manufacturer", ""),
    "model": ("Model", ""),
    "construction": ("Construction", ""),
    "serial": ("Serial number", ""),
    "dot": ("DOT code", ""),
    "rim": ("Rim", ""),
    "load_n": ("Load", "N"),
    "temperature_c": ("Temperature", "°C"),
    "boundary": ("Boundary condition", ""),
    "laboratory": ("Laboratory", ""),
    "operator": ("Operator", ""),
    "date": ("Date of test", ""),
}
#: Keys without which a test cannot be repeated.
WANTED = ("serial", "rim", "load_n", "temperature_c", "boundary", "operator", "date")
UNITS = {
    "_hz": "Hz",
    "_n": "N",
    "_kg": "kg",
    "_pa": "Pa",
    "_bar": "bar",
    "_m": "m",
    "_mm": "mm",
    "_km": "km",
    "_deg": "°",
    "_c": "°C",
    "_percent": "%",
    "_m_s": "m/s",
    "_km_h": "km/h",
    "_h": "h",
    "_s": "s",
}


def identity(result: Result) -> Section:
    """Say which tyre or structure was tested, how, and from which files the numbers come."""
    rows = (*_object_rows(result), *_origin_rows(result))
    return Section("identity", "Identity", (Facts(rows),))


def named(key: str, text: str) -> tuple[str, str]:
    """Name and value of a key of the manifest, its unit where the key's ending says it.

    ``("load_n", "4000")`` → ``("Load", "4000 N")``.
    """
    if key in KNOWN:
        name, unit = KNOWN[key]
    else:
        ending = max((e for e in UNITS if key.endswith(e) and key != e), key=len, default="")
        name, unit = key.removesuffix(ending).replace("_", " "), UNITS.get(ending, "")
        name = name[:1].upper() + name[1:]
    if not unit:
        return name, text
    return name, f"{text.removesuffix('.0')}{'' if unit == '°' else ' '}{unit}"


def _object_rows(result: Result) -> tuple[tuple[str, str], ...]:
    tyre = result.tyre
    if tyre is None:
        return (("Object", "structure, not described as a tyre"), ("Campaign", result.name))
    rows = [("Tyre", tyre.designation), ("Campaign", result.name)]
    if tyre.inflation_pressure_pa is not None:
        pressure = tyre.inflation_pressure_pa
        rows.append(("Inflation pressure", f"{pressure / 1e3:g} kPa ({pressure / 1e5:g} bar)"))
    if tyre.mean_radius_m is not None:
        rows.append(("Mean radius", f"{tyre.mean_radius_m:g} m"))
    if tyre.belt_width_m is not None:
        rows.append(("Belt width", f"{tyre.belt_width_m:g} m"))
    order = [*(key for key in KNOWN if key in tyre.details), *tyre.details]
    rows += [named(key, tyre.details[key]) for key in dict.fromkeys(order)]
    return (*rows, *_not_stated(tyre.details))


def _not_stated(details: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    missing = [key for key in WANTED if key not in details]
    if not missing:
        return ()
    names = ", ".join(KNOWN[key][0].lower() for key in missing)
    return (("Not stated", f"{names} (in the manifest under [tyre]: {', '.join(missing)})"),)


def _origin_rows(result: Result) -> tuple[tuple[str, str], ...]:
    record = result.provenance
    rows = []
    if "created" in record:
        rows.append(
            ("Processed", str(record["created"]).replace("T", " ").replace("+00:00", " UTC"))
        )
    if version := record.get("software", {}).get("ringmodal"):
        rows.append(("Software", f"ringmodal {version}"))
    inputs = record.get("inputs", ())
    if inputs:
        named_files = [
            f"{entry['file']} {str(entry['sha256'])[:CHECKSUM_DIGITS]}"
            for entry in inputs[:MOST_FILES]
        ]
        more = [f"and {len(inputs) - MOST_FILES} more"] if len(inputs) > MOST_FILES else []
        rows.append(("Files (SHA-256 begins with)", ", ".join(named_files + more)))
    return tuple(rows)
