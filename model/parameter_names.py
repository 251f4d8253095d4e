"""What the parameters of the ring are called where people read them: name, symbol, unit."""

RING_NAMES = {
    "mean_radius_m": ("mean radius", "a", "m"),
    "belt_width_m": ("belt width", "b", "m"),
    "inflation_pressure_pa": ("inflation pressure", "p₀", "Pa"),
    "mass_per_area_kg_m2": ("mass per area", "ρh", "kg/m²"),
    "radial_stiffness_n_m3": ("radial stiffness", "k_r", "N/m³"),
    "circumferential_stiffness_n_m3": ("circumferential stiffness", "k_θ", "N/m³"),
    "axial_stiffness_n_m": ("axial stiffness", "K", "N/m"),
    "bending_stiffness_n_m": ("bending stiffness", "D", "N m"),
}
DAMPING_NAMES = {
    "radial_n_s_m3": ("radial damping", "c_r", "N s/m³"),
    "circumferential_n_s_m3": ("circumferential damping", "c_θ", "N s/m³"),
    "loss_factor": ("loss factor", "η", "1"),
}
