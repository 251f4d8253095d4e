"""What the paper prints, by table, figure and section; the tables' values are in `model.reference`.

The figures are printed as pictures only: what their text says about them is what can be compared.
"""

from __future__ import annotations

#: Order whose waves Figs. 5, 7, 8 and 10 show.
WAVE_ORDER = 3
#: Angular speed of Figs. 7, 8, 10 and 12, rad/s; 80 km/h.
SPEED_RAD_S = 67.3
#: Angles of force and response in Figs. 3, 11 and 12, degrees; the response is at node 20.
FORCE_DEG, RESPONSE_DEG = 0.0, 100.0
#: End of the cycle in Fig. 5, s.
CYCLE_S = 0.008
#: Largest deviation of the tuned frequencies, percent, and the exception, Hz (section 4).
FREQUENCY_LIMIT_PERCENT, FIRST_MODE_OFF_HZ = 1.0, 3.0
#: Lowest MAC of the seven modes (section 4, Fig. 4b).
LOWEST_MAC = 0.8
#: Orders in Fig. 6a and 6b.
FIGURE_6_ORDERS = ((1, 2), (3, 4))
#: Upper end of the frequency range of interest, Hz (section 2).
HIGHEST_HZ = 300.0

# What the text says, in few words.
MODES = "seven modes between 78.73 and 224.40 Hz with damping ratios from 0.039 to 0.018"
PRELOAD = "the preload by the inflation pressure matters much for the dynamics"
GROWTH = "the steady radial displacement grows with the speed"
TUNED = "the tuned frequencies are within 1 % of the identified ones; mode 1 is 3 Hz off"
OPTIMAL = "the values are optimal"
MINIMISED = "the values minimise the sum of squares of eq 18"
SHAPES = "MAC above 0.8 for all seven modes"
LINEAR = "the bifurcation of n = 1 is linear"
RISING = "the frequencies of the regressive waves always grow with the speed"
MINIMUM = "for n > 1 those of the progressive waves have a minimum"
STANDING = "at rest the two waves form a standing wave; a cycle of n = 3 ends at 0.008 s"
RATIOS_ALIKE = "B of the regressive and of the progressive wave are very similar"
ROTATES = "seen from the rolling tyre the pattern turns"
ABSOLUTE = "seen from space it turns as well"
STANDS = "seen from the stationary reference system it stands"
DAMPING = "the damping is estimated from the modal analysis"
MATCHING = "the ring's inertance matches the measured one well in frequency and amplitude"
HIDDEN = "the bifurcation is hardly seen: damping couples the frequencies"
LOW_PEAKS = "rotation raises the peaks at low frequencies"
