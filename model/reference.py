"""The tyre of the paper, a 225/55R17: its measured modes and identified parameters (Tables 3–5).

Belt width and inflation pressure are not in the paper. With 2.2 bar, Table 4 reproduces the
frequencies of Table 3; the width is typical of a tyre of this size.
"""

from model.arguments import readonly
from model.parameters import RingDamping, RingParameters

DESIGNATION = "225/55R17"

#: Table 3: circumferential orders, natural frequencies in Hz and damping ratios, unloaded tyre.
TABLE_3_ORDERS = readonly([1, 2, 3, 4, 5, 6, 7], int)
TABLE_3_FREQUENCIES_HZ = readonly([78.73, 100.31, 121.40, 145.45, 170.78, 196.52, 224.40])
TABLE_3_DAMPING_RATIOS = readonly([0.039, 0.033, 0.024, 0.022, 0.021, 0.020, 0.018])

#: Table 4 with the measured mean radius, and the pressure and width that are not in the paper.
TABLE_4_RING = RingParameters(
    mean_radius_m=0.33,
    mass_per_area_kg_m2=19.69,
    radial_stiffness_n_m3=8.27e6,
    circumferential_stiffness_n_m3=6.56e5,
    axial_stiffness_n_m=2.52e7,
    bending_stiffness_n_m=7.45,
    inflation_pressure_pa=2.2e5,
    belt_width_m=0.19,
)

#: Table 5. It gives damping ratios 2.3 to 2.7 times those of Table 3.
TABLE_5_DAMPING = RingDamping(radial_n_s_m3=1.9e3, circumferential_n_s_m3=1.5e3, loss_factor=2.5e-2)

#: Damping that fits the ratios of Table 3, rounded from `identify_damping`.
REFITTED_DAMPING = RingDamping(
    radial_n_s_m3=686.0, circumferential_n_s_m3=800.0, loss_factor=0.0140
)
