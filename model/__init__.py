"""The flexible ring on an elastic foundation: a model of a tyre's in-plane vibration.

Every equation of the paper and where it lives; "as corrected" where its print holds a slip.

=================  ===============================================================================
eq 1a, 1b, 1c      frames: `waves` (1c on the belt), `hub` (1a, 1b for the wheel)
eq 2a, 2b          static and dynamic part of the displacement: `steady_state`, `coefficients`
eq 3, eq 40        hoop strain: `circle_fields`, whole in `deformed_energy`
eq 4, eq 47        work of the loads on the belt: `coefficients`, `deformed_energy`
eq 5               equilibrium: `steady_state.equilibrium`
eq 6, eq 7         motion of the belt (7 as corrected: the bracket of both K terms is negative and
                   holds u_r°, not u_r'): `coefficients`, `transfer`
eq 8, eq 9, eq 10  motion of the wheel: `hub`
eq 11a, 11b        harmonic waves e^{i(nθ + ωt)}: `coefficients`
eq 12              matrix of a harmonic: `coefficients.harmonics`, damped in `transfer`
eq 14              characteristic polynomial: `coefficients.Harmonics.polynomial`, roots in `roots`
eq 16              K from the radial growth: `tuning_problem.TuningProblem.axial_stiffness_n_m`
eq 17, eq 18       the paper's objective: `tuning_problem.TuningProblem.residual`
eq 19–32           waves in three frames (30b as corrected): `waves`; over speed: `rotation`
eq 33              inextensible belt: `forced.inextensional_inertance`
eq 34–39           kinetic energy: mass and gyroscopic terms in `coefficients`, `hub`, `loaded`
eq 41–43           strain energy (41 as corrected: ds): `deformed_energy`
eq 44–46           foundation energy (46 as corrected: ½): `deformed_energy`, `hub`
eq 48, eq 49       Hamilton's principle (48, 49 as corrected); no formula of its own
eq 50–55           its variations (54, 55 as corrected); they end in eqs 5–10
Tables 1, 2        signs of roots and eigenvectors (as corrected: n ≤ −1): `roots`
Tables 3, 4, 5     the paper's tyre: `reference`
=================  ===============================================================================

The numbers 13 and 15 do not occur in the paper. Beyond it: a follower pressure (`steady_state`), an
objective foundation under a free wheel (`hub`), the response to a cleat in time (`transient`,
`cleat`), the tyre pressed on the road (`loaded`), and what a fit does not determine
(`identifiability`, `sensitivity`).
"""

import lazy_loader

# The names stand in __init__.pyi, loaded where first used: a command that needs little starts fast.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
