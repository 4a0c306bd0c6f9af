//! Table 1 of the paper that the reference frontend implements ("Semi-direct RGB-D SLAM algorithm
//! for mobile robot in dynamic indoor environments"): the drift of visual odometry on the TUM RGB-D
//! benchmark, as it is printed there.
//!
//! Figures are the RMSE of the relative pose error over 1 s ([`super::rpe_over`]). DVO is Kerl,
//! Sturm and Cremers 2013, BaMVO Kim and Kim 2016, static weighting Li and Lee 2017. None of these
//! figures was measured by covis.

/// One figure for each method; `None` where it failed.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct MethodFigures {
    /// Dense visual odometry.
    pub dvo: f64,
    /// Background-model-based dense visual odometry.
    pub bamvo: f64,
    /// Static point weighting.
    pub static_weight: f64,
    /// The paper's method without removal of motion.
    pub without_removal: Option<f64>,
    /// The paper's method.
    pub with_removal: Option<f64>,
}

/// A sequence's row.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PaperRow {
    /// The paper's name of it.
    pub sequence: &'static str,
    /// How the name of the benchmark's folder ends.
    #[serde(skip)]
    pub folder: &'static str,
    /// Translation in m/s.
    pub translation_m_per_s: MethodFigures,
    /// Rotation in °/s.
    pub rotation_deg_per_s: MethodFigures,
}

/// DVO, BaMVO, static weight, ours without and with removal; a NaN is a failure.
const fn figures(values: [f64; 5]) -> MethodFigures {
    let [dvo, bamvo, static_weight, without, with] = values;
    let without_removal = if without.is_nan() { None } else { Some(without) };
    let with_removal = if with.is_nan() { None } else { Some(with) };
    MethodFigures { dvo, bamvo, static_weight, without_removal, with_removal }
}

const fn row(
    (sequence, folder): (&'static str, &'static str),
    translation: [f64; 5],
    rotation: [f64; 5],
) -> PaperRow {
    PaperRow {
        sequence,
        folder,
        translation_m_per_s: figures(translation),
        rotation_deg_per_s: figures(rotation),
    }
}

/// A failure.
const X: f64 = f64::NAN;

/// The table, in its own order.
#[rustfmt::skip]
pub const PAPER_TABLE: [PaperRow; 11] = [
    row(("fr2/desk", "freiburg2_desk"),
        [0.0296, 0.0299, 0.0173, 0.0115, 0.0111], [1.3920, 1.1167, 0.7266, 0.5466, 0.5565]),
    row(("fr3/long-house", "freiburg3_long_office_household"),
        [0.0231, 0.0332, 0.0168, 0.0134, 0.0160], [1.5689, 2.1583, 0.8012, 0.5086, 0.5167]),
    row(("fr2/desk-person", "freiburg2_desk_with_person"),
        [0.0354, 0.0352, 0.0173, 0.0098, 0.0094], [1.5368, 1.2159, 0.8213, 0.4685, 0.4674]),
    row(("fr3/sitting-static", "freiburg3_sitting_static"),
        [0.0157, 0.0248, 0.0231, 0.0111, 0.0081], [0.6084, 0.6977, 0.7228, 0.3223, 0.2552]),
    row(("fr3/sitting-xyz", "freiburg3_sitting_xyz"),
        [0.0453, 0.0482, 0.0219, 0.0137, 0.0131], [1.4980, 1.3885, 0.8466, 0.4941, 0.4941]),
    row(("fr3/sitting-rpy", "freiburg3_sitting_rpy"),
        [0.1735, 0.1872, 0.0843, 0.0231, 0.0229], [6.0164, 5.9834, 5.6258, 0.7456, 0.6991]),
    row(("fr3/sitting-halfsphere", "freiburg3_sitting_halfsphere"),
        [0.1005, 0.0589, 0.0389, 0.0340, 0.0263], [4.6490, 2.8804, 1.8836, 0.9493, 0.7838]),
    row(("fr3/walking-static", "freiburg3_walking_static"),
        [0.3818, 0.1339, 0.0327, 0.0278, 0.0102], [6.3502, 2.0833, 0.8085, 0.4903, 0.2525]),
    row(("fr3/walking-xyz", "freiburg3_walking_xyz"),
        [0.4360, 0.2326, 0.0651, 0.1184, 0.0320], [7.6669, 4.3911, 1.6442, 2.1494, 0.6869]),
    row(("fr3/walking-rpy", "freiburg3_walking_rpy"),
        [0.4038, 0.3584, 0.2252, X, X], [7.0662, 6.3389, 5.6902, X, X]),
    row(("fr3/walking-halfsphere", "freiburg3_walking_halfsphere"),
        [0.2638, 0.1738, 0.0527, 0.1184, 0.0476], [5.2179, 4.2863, 2.4048, 1.8284, 1.045]),
];

/// The row of a folder of the benchmark, by its name (`rgbd_dataset_freiburg3_walking_xyz`).
#[must_use]
pub fn paper_row(folder_name: &str) -> Option<&'static PaperRow> {
    PAPER_TABLE.iter().find(|row| folder_name.ends_with(row.folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_find_their_rows() {
        let sequence = |folder| paper_row(folder).map(|row| row.sequence);
        assert_eq!(sequence("rgbd_dataset_freiburg2_desk"), Some("fr2/desk"));
        assert_eq!(sequence("rgbd_dataset_freiburg2_desk_with_person"), Some("fr2/desk-person"));
        assert_eq!(sequence("freiburg3_walking_xyz"), Some("fr3/walking-xyz"));
        for unknown in ["rgbd_dataset_freiburg1_rpy", "freiburg3_walking_xyz_validation", ""] {
            assert_eq!(sequence(unknown), None, "{unknown}");
        }
        for row in &PAPER_TABLE {
            assert_eq!(sequence(row.folder), Some(row.sequence));
        }
    }

    #[test]
    fn the_paper_s_own_conclusions_follow_from_its_table() {
        // The paper calls seated people low dynamics, people who walk about high.
        let (low, high) = (["sitting", "person"], ["walking", "walking"]);
        let mean = |words: [&str; 2], against: fn(&MethodFigures) -> Option<f64>| {
            let is_of = |row: &&PaperRow| words.iter().any(|word| row.sequence.contains(word));
            let rows = PAPER_TABLE.iter().filter(is_of);
            let gain = |row: &PaperRow| {
                let figures = &row.translation_m_per_s;
                Some(1.0 - figures.with_removal? / against(figures)?)
            };
            let gains: Vec<f64> = rows.filter_map(gain).collect();
            (gains.len(), gains.iter().sum::<f64>() / gains.len() as f64)
        };
        let (count, gain) = mean(high, |f| f.without_removal);
        assert!(count == 3 && (gain - 0.649).abs() < 0.01, "{gain}");
        let (count, gain) = mean(high, |f| Some(f.static_weight));
        assert!(count == 3 && (gain - 0.431).abs() < 0.02, "{gain}");
        let (count, gain) = mean(low, |f| Some(f.static_weight));
        assert!(count == 5 && (gain - 0.506).abs() < 0.02, "{gain}");
    }
}
