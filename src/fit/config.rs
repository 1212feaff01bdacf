//! In: TOML. Out: every number of Stage III that a user may want to change, with units and sensible defaults.

use serde::{Deserialize, Serialize};

/// Settings of Stage III. Every field has a default; unknown fields are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitConfig {
    /// Stature of everybody in view, metres, where it is known. Fixes depth, which one camera cannot.
    pub height: Option<f64>,
    /// Stature, metres, that people are taken for while nothing better is known: that of most adults.
    pub default_height: f64,
    /// The floor, where it is known.
    pub ground: Option<GroundConfig>,
    /// Find the floor from standing feet. Without `ground` this yields a floor-aligned world, and how tall people are
    /// beside each other; together they are as tall as assumed.
    pub estimate_ground: bool,
    /// Every frame is a picture of its own: no motion between frames, everybody is born at once.
    pub stills: bool,
    /// Evidence joints seen with less confidence than this (0–1) are treated as not seen.
    pub min_joint_confidence: f64,
    /// 1€ filter of 2D joints (in metres at the person's distance).
    pub filter2d: OneEuroConfig,
    /// 1€ filter of 3D joints (metres).
    pub filter3d: OneEuroConfig,
    /// Terms of the energy.
    pub terms: TermsConfig,
    /// Who is who.
    pub identity: IdentityConfig,
    /// Extrapolation between and after observations.
    pub prediction: PredictionConfig,
}

/// A known floor in camera axes (x right, y down, z forward): points p with normal · p + offset = 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundConfig {
    /// Direction away from the floor, roughly (0, −1, 0), never downwards; need not be a unit vector.
    pub normal: [f64; 3],
    /// Height of the camera above the floor, metres.
    pub offset: f64,
}

/// Casiez et al., CHI 2012.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OneEuroConfig {
    /// Whether the filter is used at all.
    pub enabled: bool,
    /// Cutoff at rest, Hz.
    pub min_cutoff: f64,
    /// Rise of the cutoff with speed, Hz per m/s.
    pub beta: f64,
    /// Cutoff of the speed itself, Hz.
    pub derivative_cutoff: f64,
}

/// Weights are factors: 1 is the tuned value, 0 switches a term off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TermsConfig {
    /// E3D: joints relative to the pelvis against Stage II.
    pub position: f64,
    /// E2D: reprojection against the evidence joints.
    pub reprojection: f64,
    /// Etemp: change of velocity.
    pub temporal: f64,
    /// Standing feet stay where they stand.
    pub contact: f64,
    /// Expected error of Stage II's joints, metres at canonical stature.
    pub sigma3d: f64,
    /// Expected error of evidence joints, metres at the person's distance.
    pub sigma2d: f64,
}

/// Birth, death and return of identities. Times in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IdentityConfig {
    /// Observations before a person is published …
    pub confirm_hits: u32,
    /// … or two in a row that lie this far apart: at few frames a second they tell as much.
    pub confirm_time: f64,
    /// Age from which somebody who is recognised as nobody gets a new identity, where observations come less than
    /// `confirm_time` apart: whoever comes out of hiding looks like somebody else for the first frames.
    pub birth_time: f64,
    /// A person not confirmed is dropped after this long without being seen.
    pub tentative_grace: f64,
    /// A person not seen is published as predicted for this long.
    pub grace: f64,
    /// A person not seen is expected near the last place for this long, after which looks alone decide.
    pub hold: f64,
    /// A person who left keeps the identity for this long.
    pub memory: f64,
    /// Dissimilarity beyond which an observation is somebody else.
    pub threshold: f64,
    /// Weight of the appearance in the dissimilarity.
    pub appearance_weight: f64,
    /// Difference of appearance (0–1) up to which somebody who comes back is recognised.
    pub reidentify_appearance: f64,
    /// Time between refreshes of the remembered appearance.
    pub refresh: f64,
    /// Score (0–1) of a first observation from which somebody is published at once, where nobody known is away.
    pub sure_score: f64,
}

/// Bounds of extrapolation. Times in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PredictionConfig {
    /// Longest extrapolation beyond the newest observation for display.
    pub max: f64,
    /// Time constant with which the root's velocity fades where nothing is seen.
    pub root_fade: f64,
    /// Time constant with which joint velocities fade where nothing is seen.
    pub joint_fade: f64,
}

impl Default for FitConfig {
    fn default() -> Self {
        Self {
            height: None,
            default_height: 1.70,
            ground: None,
            estimate_ground: true,
            stills: false,
            min_joint_confidence: 0.05,
            filter2d: OneEuroConfig::default(),
            filter3d: OneEuroConfig::default(),
            terms: TermsConfig::default(),
            identity: IdentityConfig::default(),
            prediction: PredictionConfig::default(),
        }
    }
}

impl Default for OneEuroConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            min_cutoff: 4.0,
            beta: 4.0,
            derivative_cutoff: 2.0,
        }
    }
}

impl Default for TermsConfig {
    fn default() -> Self {
        Self {
            position: 1.0,
            reprojection: 1.0,
            temporal: 1.0,
            contact: 1.0,
            sigma3d: 0.045,
            sigma2d: 0.042,
        }
    }
}

impl Default for IdentityConfig {
    fn default() -> Self {
        Self {
            confirm_hits: 3,
            confirm_time: 0.1,
            // Not 0.2: where frames come 30 a second, rounding would decide between six of them and seven.
            birth_time: 0.19,
            tentative_grace: 0.2,
            grace: 0.1,
            hold: 2.5,
            memory: 60.0,
            threshold: 1.4,
            appearance_weight: 1.8,
            reidentify_appearance: 0.3,
            refresh: 30.0,
            sure_score: 0.95,
        }
    }
}

impl Default for PredictionConfig {
    fn default() -> Self {
        Self {
            max: 0.1,
            root_fade: 0.6,
            joint_fade: 0.15,
        }
    }
}

/// Why a configuration is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// No TOML of the expected shape.
    #[error("expected settings of the fit, found: {0}; correct or remove the field")]
    Syntax(#[from] toml::de::Error),
    /// A value outside its range.
    #[error("expected {field} {expected}, found {found}; correct the setting")]
    Range {
        /// The setting.
        field: &'static str,
        /// Its range.
        expected: &'static str,
        /// Its value.
        found: f64,
    },
}

impl ConfigError {
    /// The setting that is out of its range.
    pub fn field(&self) -> Option<&'static str> {
        match self {
            Self::Range { field, .. } => Some(field),
            Self::Syntax(_) => None,
        }
    }
}

impl FitConfig {
    /// Reads settings from TOML; what is not mentioned keeps its default.
    ///
    /// # Errors
    /// [`ConfigError`] for unknown fields, wrong types and values out of range.
    pub fn parse(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text)?;
        config.check()?;
        Ok(config)
    }

    /// Checks every value's range.
    ///
    /// # Errors
    /// [`ConfigError::Range`] for the first value out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let within = |field, found: f64, low: f64, high: f64, expected| {
            if found >= low && found <= high {
                Ok(())
            } else {
                Err(ConfigError::Range {
                    field,
                    expected,
                    found,
                })
            }
        };
        const METRES: &str = "from 0.4 to 2.8 (metres)";
        const FACTOR: &str = "from 0 to 1000";
        const SECONDS: &str = "from 0 to 3600 (seconds)";
        const HERTZ: &str = "from 0.001 to 1000 (hertz)";
        if let Some(height) = self.height {
            within("height", height, 0.4, 2.8, METRES)?;
        }
        within("default_height", self.default_height, 0.4, 2.8, METRES)?;
        if let Some(ground) = &self.ground {
            let length = ground.normal.iter().map(|v| v * v).sum::<f64>().sqrt();
            within(
                "ground.normal",
                length,
                1e-3,
                1e6,
                "of a direction's length",
            )?;
            // A camera that looks straight down has 0.
            within(
                "ground.normal",
                ground.normal[1],
                -1e6,
                0.0,
                "whose second number is at most 0: camera y points down, this away from the floor, as 0, -1, 0",
            )?;
            within(
                "ground.offset",
                ground.offset,
                0.05,
                100.0,
                "from 0.05 to 100 (metres)",
            )?;
        }
        within(
            "identity.sure_score",
            self.identity.sure_score,
            0.0,
            1.0,
            "from 0 to 1",
        )?;
        within(
            "min_joint_confidence",
            self.min_joint_confidence,
            0.0,
            1.0,
            "from 0 to 1",
        )?;
        let [f2, f3] = [&self.filter2d, &self.filter3d];
        for (field, hertz) in [
            ("filter2d.min_cutoff", f2.min_cutoff),
            ("filter2d.derivative_cutoff", f2.derivative_cutoff),
            ("filter3d.min_cutoff", f3.min_cutoff),
            ("filter3d.derivative_cutoff", f3.derivative_cutoff),
        ] {
            within(field, hertz, 1e-3, 1e3, HERTZ)?;
        }
        within("filter2d.beta", f2.beta, 0.0, 1e3, FACTOR)?;
        within("filter3d.beta", f3.beta, 0.0, 1e3, FACTOR)?;
        let t = &self.terms;
        for (field, value) in [
            ("terms.position", t.position),
            ("terms.reprojection", t.reprojection),
            ("terms.temporal", t.temporal),
            ("terms.contact", t.contact),
        ] {
            within(field, value, 0.0, 1e3, FACTOR)?;
        }
        within(
            "terms.sigma3d",
            t.sigma3d,
            1e-3,
            1.0,
            "from 0.001 to 1 (metres)",
        )?;
        within(
            "terms.sigma2d",
            t.sigma2d,
            1e-3,
            1.0,
            "from 0.001 to 1 (metres)",
        )?;
        let i = &self.identity;
        within(
            "identity.confirm_hits",
            i.confirm_hits as f64,
            1.0,
            1e3,
            "from 1 to 1000",
        )?;
        for (field, value) in [
            ("identity.confirm_time", i.confirm_time),
            ("identity.birth_time", i.birth_time),
            ("identity.tentative_grace", i.tentative_grace),
            ("identity.grace", i.grace),
            ("identity.hold", i.hold),
            ("identity.memory", i.memory),
            ("identity.refresh", i.refresh),
        ] {
            within(field, value, 0.0, 3600.0, SECONDS)?;
        }
        for (field, value) in [
            ("identity.threshold", i.threshold),
            ("identity.appearance_weight", i.appearance_weight),
            ("identity.reidentify_appearance", i.reidentify_appearance),
        ] {
            within(field, value, 0.0, 1e3, FACTOR)?;
        }
        let p = &self.prediction;
        within("prediction.max", p.max, 0.0, 1.0, "from 0 to 1 (seconds)")?;
        within(
            "prediction.root_fade",
            p.root_fade,
            1e-3,
            60.0,
            "from 0.001 to 60 (seconds)",
        )?;
        within(
            "prediction.joint_fade",
            p.joint_fade,
            1e-3,
            60.0,
            "from 0.001 to 60 (seconds)",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_toml_overrides_them() {
        FitConfig::default().check().unwrap();
        let config = FitConfig::parse(
            "height = 1.8\n[filter2d]\nbeta = 2.5\n[ground]\nnormal = [0, -1, 0]\noffset = 1.5",
        )
        .unwrap();
        assert_eq!(config.height, Some(1.8));
        assert_eq!(config.filter2d.beta, 2.5);
        assert_eq!(
            config.filter2d.min_cutoff,
            OneEuroConfig::default().min_cutoff
        );
        assert_eq!(config.ground.unwrap().offset, 1.5);
    }

    #[test]
    fn mistakes_are_named() {
        for (text, expected) in [
            ("heigth = 1.8", "heigth"),
            ("height = 18", "height"),
            ("height = nan", "height"),
            ("[filter2d]\nmin_cutoff = 0", "min_cutoff"),
            ("[ground]\nnormal = [0, 0, 0]\noffset = 1", "ground.normal"),
            (
                "[ground]\nnormal = [0, 1, 0]\noffset = 1",
                "expected ground.normal whose second number is at most 0: camera y points down",
            ),
            ("[identity]\nconfirm_hits = 0", "confirm_hits"),
        ] {
            let error = FitConfig::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
