"""What SDynPy makes of a universal file, as JSON; run by a Python that has SDynPy installed.

A program of its own, since SDynPy is under another licence and brings a user interface.
"""

import json
import sys

import sdynpy
from sdynpy.fileio.sdynpy_uff import readunv


def parts(values):
    return [values.real.tolist(), values.imag.tolist()]


def along_global(coordinates):
    """What SDynPy takes each degree of freedom for, as unit vectors of the global system."""
    return geometry.global_deflection(coordinates).tolist()


content = readunv(sys.argv[1])
shapes = sdynpy.shape.ShapeArray.from_unv(content)
geometry = sdynpy.Geometry.from_unv(content)
frfs = sdynpy.data.NDDataArray.from_unv(content)
if isinstance(frfs, list):
    (frfs,) = frfs
sys.stdout.write(
    json.dumps(
        {
            "datasets": {str(number): len(held) for number, held in content.items()},
            "frequency_hz": shapes.frequency.tolist(),
            "damping_ratio": shapes.damping.tolist(),
            "modal": parts(shapes.modal_mass.astype(complex)),
            "shape_node": shapes.coordinate.node[0].tolist(),
            "shape_direction": shapes.coordinate.direction[0].tolist(),
            "shape_global": along_global(shapes.coordinate[0]),
            "shapes": parts(shapes.shape_matrix.astype(complex)),
            "node": geometry.node.id.tolist(),
            "xyz_m": geometry.node.coordinate.tolist(),
            "line": [each.tolist() for each in geometry.traceline.connectivity],
            "frf_hz": frfs.abscissa[0].tolist(),
            "frfs": parts(frfs.ordinate),
            "frf_nodes": frfs.coordinate.node.tolist(),
            "frf_kind": type(frfs).__name__,
            "frf_global": along_global(frfs.coordinate.reshape(-1)),
        }
    )
)
