"""pipelines.results.conditions."""

from __future__ import annotations


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
