"""Charts of the ring's parameters: what each does to the frequencies, how they hang together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from model.identifiability import Correlation, Sensitivity
from pipelines.plots.chart import Chart
from pipelines.plots.charts_matrix import signed_chart
from pipelines.storage.rounding import signed


def sensitivity_chart(found: Sensitivity, symbols: Mapping[str, str]) -> Chart:
    """Change of each frequency in percent for one percent of each parameter.

    Parameters
    ----------
    found : Sensitivity
    symbols : mapping of str to str
        Field of the ring → symbol.
    """
    names = [symbols[name] for name in found.parameters]
    strongest = np.max(np.abs(found.values), axis=0)
    weak = [name for name, most in zip(names, strongest, strict=True) if most < 0.02]
    finding = f"{' and '.join(weak)} hardly move any frequency" if weak else "all move some"
    return signed_chart(
        found.values,
        [f"{order}" for order in found.orders],
        names,
        name="sensitivity",
        titles=("order n", "parameter"),
        quantity="d ln f / d ln p",
        alternative=f"Sensitivity of {found.orders.size} frequencies to {len(names)} parameters; "
        f"{finding}.",
        caption="Sensitivity d ln f / d ln p: change of a frequency in % for 1 % of a parameter, "
        "the others held. A pale column is a parameter that these frequencies cannot determine "
        f"({finding}); columns alike in all orders cannot be told from each other.",
    )


def correlation_chart(found: Correlation, symbols: Mapping[str, str]) -> Chart:
    """Correlation coefficients of the identified parameters.

    Parameters
    ----------
    found : Correlation
        Finite, of two parameters or more.
    symbols : mapping of str to str
        Field of the ring → symbol.
    """
    names = [symbols[name] for name in found.parameters]
    beside = np.abs(found.values - np.diag(np.diag(found.values)))
    row, column = np.unravel_index(int(np.argmax(beside)), beside.shape)
    strongest = f"{names[row]} with {names[column]}, {signed(found.values[row, column], 2)}"
    return signed_chart(
        found.values,
        names,
        names,
        name="parameter-correlation",
        titles=("parameter", "parameter"),
        quantity="correlation",
        alternative=f"Correlation of {len(names)} parameters; the strongest is {strongest}.",
        caption=f"Correlation of the parameters; the strongest is {strongest}. Near ±1 the "
        "measurement fixes a combination of two parameters much better than each by itself: give "
        "one of them to sharpen the other.",
    )
