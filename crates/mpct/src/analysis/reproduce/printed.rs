//! The numbers that the paper prints.

/// Table 1: λ, M̃ and cumulative cost (·10⁶) of the academic example, M̃ and cumulative cost (·10⁶) of the drone.
pub const TABLE_1: [(f64, usize, f64, usize, f64); 7] = [
    (0.99, 10, 2.0067, 203, 3.1548),
    (0.89, 5, 2.4813, 88, 3.1548),
    (0.79, 4, 3.0960, 64, 3.1548),
    (0.69, 3, 3.8597, 50, 11.5174),
    (0.59, 3, 4.7774, 39, 44.8102),
    (0.49, 3, 5.8491, 31, 112.0422),
    (0.39, 2, 7.0748, 25, 271.2111),
];

/// A column of Table 2: seconds, `None` where the paper has a dash.
pub struct PrintedTimes {
    /// Number of carts.
    pub carts: usize,
    /// Offline, explicit.
    pub explicit_offline: Option<f64>,
    /// Offline, implicit.
    pub implicit_offline: f64,
    /// Online, explicit.
    pub explicit_online: Option<f64>,
    /// Online, implicit.
    pub implicit_online: f64,
}

const fn times(
    carts: usize,
    explicit_offline: Option<f64>,
    implicit_offline: f64,
    explicit_online: Option<f64>,
    implicit_online: f64,
) -> PrintedTimes {
    PrintedTimes {
        carts,
        explicit_offline,
        implicit_offline,
        explicit_online,
        implicit_online,
    }
}

/// Table 2.
pub const TABLE_2: [PrintedTimes; 10] = [
    times(3, Some(7.6293), 2.7063, Some(0.0085), 0.0095),
    times(5, Some(15.5986), 3.7123, Some(0.0107), 0.0189),
    times(10, Some(54.4716), 6.8664, Some(0.0761), 0.1122),
    times(15, Some(153.2055), 21.5659, Some(0.1170), 0.1256),
    times(25, Some(541.9198), 52.3099, Some(0.2924), 0.1582),
    times(30, Some(799.4687), 73.6518, Some(0.3138), 0.1904),
    times(50, Some(3.0095e3), 201.9882, Some(0.2052), 0.3101),
    times(70, Some(8.7399e3), 390.5777, Some(0.2010), 0.4831),
    times(100, Some(6.9640e4), 881.0654, Some(0.3200), 0.7917),
    times(200, None, 4.6101e3, None, 2.0693),
];

/// The set-point of Figure 2.
pub const FIGURE_2_SET_POINT: [f64; 2] = [-0.5688, -0.0523];
/// M̄, γ, α and d of Figure 2. The paper does not say how d was found; ours is α λ_min(P⁻¹Q).
pub const FIGURE_2: (usize, f64, f64, f64) = (2, 20.0, 25.0, 5.6322);
