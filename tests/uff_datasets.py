"""Datasets of universal files, built as text: shapes and coordinate systems."""

from builders import dataset, row

NORMAL, COMPLEX = 2, 3


VECTOR, SIX = 2, 3


REAL, COMPLEX_VALUES = 2, 5


SHAPE = {1: [1.0, -2.0, 0.5], 2: [0.0, 0.25, -1e-3]}


def values_text(shape):
    lines = []
    for node, numbers in shape.items():
        parts = [part for each in numbers for part in as_parts(each)]
        lines.append(row("10d", node))
        lines += [
            "".join(f"{part:13.5E}" for part in parts[k : k + 6]) for k in range(0, len(parts), 6)
        ]
    return lines


def as_parts(number):
    return (number.real, number.imag) if isinstance(number, complex) else (number,)


def shape55(
    shape=SHAPE,
    *,
    analysis=NORMAL,
    characteristic=VECTOR,
    result=8,
    kind=REAL,
    n=3,
    reals=(80.0, 1.0, 0.03, 0.0),
):
    head = row("10d " * 6, 1, analysis, characteristic, result, kind, n)
    counts = row("10d " * 4, 2, len(reals), 1, 1)
    return dataset(
        55, *["NONE"] * 5, head, counts, row("13.5E " * len(reals), *reals), *values_text(shape)
    )


def shape2414(
    shape=SHAPE,
    *,
    location=1,
    analysis=NORMAL,
    characteristic=VECTOR,
    result=8,
    kind=REAL,
    n=3,
    reals=(0.0, 80.0, 0.0, 1.0, 0.03, 0.0, 0.0, 0.0),
):
    reals = [*reals, *[0.0] * (12 - len(reals))]
    head = row("10d " * 6, 1, analysis, characteristic, result, kind, n)
    zeros = row("10d " * 8, *[0] * 8)
    return dataset(
        2414,
        row("10d", 1),
        "Mode 1",
        row("10d", location),
        *["NONE"] * 5,
        head,
        zeros,
        row("10d 10d", 0, 0),
        row("13.5E " * 6, *reals[:6]),
        row("13.5E " * 6, *reals[6:]),
        *values_text(shape),
    )


CARTESIAN, CYLINDRICAL, SPHERICAL = 0, 1, 2


def nodes_in(system, coordinates):
    """Dataset 15 with a coordinate system of its own."""
    rows = [
        row("10d 10d 10d 10d 13.5E 13.5E 13.5E", node, system, 0, 0, *point)
        for node, point in coordinates.items()
    ]
    return dataset(15, *rows)


def system18(number, kind=CARTESIAN, reference=0, origin=(0, 0, 0), x=(1, 0, 0), xz=(0, 0, 1)):
    return dataset(
        18,
        row("10d 10d 10d 10d 10d", number, kind, reference, 1, 1),
        f"CS{number}",
        row("13.5E " * 6, *origin, *x),
        row("13.5E " * 3, *xz) + "  ",
    )


def system2420(number, kind, axes, origin):
    rows = [row("25.16E " * 3, *each).replace("E", "D") for each in (*axes, origin)]
    return dataset(2420, row("10d", 1), "Part", row("10d 10d 10d", number, kind, 8), "CS", *rows)
