//! Which settings of the fit count where several cameras see the same people.

use crate::fit::FitConfig;
use crate::fit::config::{IdentityConfig, TermsConfig};

/// Settings that are not the usual ones and are not used by [`LiveFit`](super::LiveFit), under the names that a file
/// gives them.
pub fn without_meaning(config: &FitConfig) -> Vec<&'static str> {
    let usual = FitConfig::default();
    let all = &usual.identity;
    // Every field by name, so that somebody who adds one has to say here whether it counts.
    let FitConfig {
        default_height,
        ground,
        estimate_ground,
        stills,
        filter2d,
        filter3d,
        height: _,
        min_joint_confidence: _,
        terms,
        identity,
        prediction: _,
    } = config;
    let TermsConfig {
        contact,
        position: _,
        reprojection: _,
        temporal: _,
        sigma3d: _,
        sigma2d: _,
    } = terms;
    let IdentityConfig {
        confirm_hits,
        confirm_time,
        birth_time,
        threshold,
        appearance_weight,
        refresh: _,
        sure_score,
        tentative_grace: _,
        grace: _,
        hold: _,
        memory: _,
        reidentify_appearance: _,
    } = identity;
    let unused = [
        ("default_height", *default_height != usual.default_height),
        ("ground", *ground != usual.ground),
        ("estimate_ground", *estimate_ground != usual.estimate_ground),
        ("stills", *stills != usual.stills),
        ("filter2d", *filter2d != usual.filter2d),
        ("filter3d", *filter3d != usual.filter3d),
        ("terms.contact", *contact != usual.terms.contact),
        ("identity.confirm_hits", *confirm_hits != all.confirm_hits),
        ("identity.confirm_time", *confirm_time != all.confirm_time),
        ("identity.birth_time", *birth_time != all.birth_time),
        ("identity.threshold", *threshold != all.threshold),
        (
            "identity.appearance_weight",
            *appearance_weight != all.appearance_weight,
        ),
        ("identity.sure_score", *sure_score != all.sure_score),
    ];
    let other = unused.into_iter().filter(|(_, differs)| *differs);
    other.map(|(name, _)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_used_is_named_where_it_is_given() {
        let named = |text: &str| without_meaning(&FitConfig::parse(text).unwrap());
        assert!(named("").is_empty());
        let used = "height = 1.8\nmin_joint_confidence = 0.1\n[prediction]\nmax = 0.2\n[terms]\nposition = 2\n\
                    [identity]\nmemory = 5\ngrace = 0.3\nrefresh = 10";
        assert!(named(used).is_empty());
        assert_eq!(
            named(
                "default_height = 1.6\n[identity]\nconfirm_hits = 5\nmemory = 5\n[filter3d]\nbeta = 2"
            ),
            ["default_height", "filter3d", "identity.confirm_hits"]
        );
    }
}
