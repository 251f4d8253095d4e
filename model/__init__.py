"""The flexible ring on an elastic foundation: a model of a tyre's in-plane vibration.

The equations of the paper and their modules; "as corrected" where the print has a slip.

=================  ===============================================================================
eq 1a, 1b, 1c      frames: `waves` (1c on the belt), `hub` (1a, 1b for the wheel)
eq 2a, 2b          static and dynamic part of the displacement: `coefficients`
eq 3, eq 40        hoop strain: `circle_fields`
eq 4, eq 47        work of the loads on the belt: `coefficients`, `circle_fields`
eq 5               equilibrium: `coefficients.equilibrium`
eq 6, eq 7         motion of the belt (7 as corrected: the bracket of both K terms is negative and
                   holds u_r°, not u_r'): `coefficients`, `forced`
eq 8, eq 9, eq 10  motion of the wheel: `hub`
eq 11a, 11b        harmonic waves e^{i(nθ + ωt)}: `coefficients`
eq 12              matrix of a harmonic: `coefficients.harmonics`, damped in `forced`
eq 14              characteristic polynomial and its roots: `coefficients`
eq 16              K from the radial growth: `tuning_problem.TuningProblem.axial_stiffness_n_m`
eq 17, eq 18       the paper's objective: `tuning_problem.TuningProblem.residual`
eq 19–32           waves in three frames (30b as corrected): `waves`
eq 33              inextensible belt: `forced.inextensional_inertance`
eq 34–39           kinetic energy: mass and gyroscopic terms in `coefficients`, `hub`, `loaded`
eq 41–43           strain energy (41 as corrected: ds): `circle_fields`
eq 44–46           foundation energy (46 as corrected: ½): `circle_fields`, `hub`
eq 48, eq 49       Hamilton's principle (48, 49 as corrected); no formula of its own
eq 50–55           its variations (54, 55 as corrected); they end in eqs 5–10
Tables 1, 2        signs of roots and eigenvectors (as corrected: n ≤ −1): `coefficients`
Tables 3, 4, 5     the paper's tyre: `reference`
=================  ===============================================================================

The paper has no eqs 13 and 15. Beyond it: a follower pressure (`coefficients`), an objective
foundation under a free wheel (`hub`), the response to a cleat in time (`cleat`), the tyre pressed
on the road (`loaded`, `road`), and what a fit does not determine (`identifiability`).
"""

import lazy_loader

# Names are listed in __init__.pyi and loaded at first use, so that commands start fast.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
