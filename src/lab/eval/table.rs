//! A report as text.

use std::fmt::{self, Display, Formatter};

use edgecap_client::joints::HEAD_TOP;

use super::{JointSet, PckhScore, Protocol, Report};

fn row(f: &mut Formatter<'_>, name: &str, value: impl Display) -> fmt::Result {
    writeln!(f, "{name:<36}{value}")
}

fn percent(x: f64) -> String {
    if x < 0.0 {
        "-".into()
    } else {
        format!("{:.1} %", 100.0 * x)
    }
}

/// A figure, or a dash where there is nothing that it could be of.
fn known(x: Option<f64>, text: impl Fn(f64) -> String) -> String {
    x.map_or("–".to_owned(), text)
}

/// How many heads, and what told their size.
fn heads_of(p: &PckhScore) -> String {
    let kinds = [
        (p.people - p.head_by_joints, "by box"),
        (p.head_by_joints, "by 0.75 of upper neck to head top"),
        (p.without_head, "unknown and left out"),
    ];
    let kinds = kinds.iter().filter(|(n, _)| *n > 0);
    let kinds: Vec<String> = kinds.map(|(n, how)| format!("{n} {how}")).collect();
    kinds.join(", ")
}

impl Display for Report {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let Some(q) = self.quiet {
            row(f, "pictures without people", q.pictures)?;
            row(f, "  with nobody reported", percent(q.share()))?;
            return row(f, "  people reported", q.people);
        }
        let missing = match self.frames_without_prediction {
            0 => String::new(),
            n => format!(" ({n} without any prediction)"),
        };
        row(f, "frames", format!("{}{missing}", self.frames))?;
        row(f, "people predicted", self.predicted_people)?;
        self.finding(f)?;
        self.joints(f)?;
        self.heads(f)?;
        self.solid(f)?;
        self.time(f)
    }
}

impl Report {
    fn finding(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let Some(c) = self.coco {
            let set = match self.joints {
                JointSet::Shared => "12 shared joints",
                JointSet::Evidence => "evidence joints",
                JointSet::All => "all labelled points",
            };
            row(f, "OKS over", set)?;
            row(f, "  people that count", c.people)?;
            let ap = [("AP", c.ap), ("AP50", c.ap50), ("AP75", c.ap75)];
            for (name, x) in ap.into_iter().chain([("AR", c.ar), ("AR50", c.ar50)]) {
                row(f, &format!("  {name}"), percent(x))?;
            }
        }
        for k in &self.finding {
            let text = format!(
                "recall {} of {}, precision {}, {} false, mean OKS {}",
                known(k.recall, percent),
                k.people,
                known(k.precision, percent),
                k.false_people,
                known(k.mean_oks, |x| format!("{x:.3}"))
            );
            row(f, &format!("found at OKS {:.2}", k.oks), text)?;
        }
        for (rows, unit, step) in [
            (&self.recall_by_height, "px tall", 0.0),
            (&self.recall_by_joints, "joints in sight", 1.0),
            (&self.recall_by_company, "in the picture", 1.0),
        ] {
            for r in rows {
                // Whole numbers are said to the last one of the row, lengths to where the next row begins.
                let to = r.to - step;
                let range = if to <= r.from {
                    format!("{:.0}", r.from)
                } else if to.is_finite() {
                    format!("{:.0}-{to:.0}", r.from)
                } else {
                    format!("from {:.0}", r.from)
                };
                let text = format!("{} of {}", percent(r.recall), r.people);
                row(f, &format!("  {range} {unit}, OKS 0.50"), text)?;
            }
        }
        Ok(())
    }

    fn joints(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Some(pck) = self.pck else { return Ok(()) };
        row(f, "PCK@0.2 of the torso", percent(pck))?;
        for (name, share) in &self.pck_per_joint {
            if let Some(share) = share {
                row(f, &format!("  {name}"), percent(*share))?;
            }
        }
        Ok(())
    }

    fn heads(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Some(p) = &self.pckh else { return Ok(()) };
        let of = format!("{}, heads: {}", percent(p.mean), heads_of(p));
        row(f, "PCKh@0.5 of the head's size", of)?;
        for (name, share) in &p.parts {
            let mut text = known(*share, percent);
            // Tables of the validation set have the top alone, those of the test set both.
            let top = p.per_joint[HEAD_TOP].1;
            if let Some(top) = top.filter(|_| *name == "head") {
                text += &format!(", its top alone {}", percent(top));
            }
            row(f, &format!("  {name}"), text)?;
        }
        Ok(())
    }

    fn solid(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let Some(p) = &self.pose3d {
            let matched = format!("{} of {}", p.people, p.truth);
            row(f, "3D people matched from OKS 0.10 on", matched)?;
            let each = p.joints as f64 / p.people as f64;
            let text = format!("{:.1} mm of {each:.0} joints, the pelvis too", p.mpjpe_mm);
            row(f, "  MPJPE", text)?;
            let same_size = known(p.canonical_mpjpe_mm, |e| format!("{e:.1} mm"));
            row(f, "  MPJPE at 1.70 m", same_size)?;
            row(f, "  N-MPJPE", format!("{:.1} mm", p.n_mpjpe_mm))?;
            row(f, "  PA-MPJPE", format!("{:.1} mm", p.pa_mpjpe_mm))?;
            row(f, "  3DPCK@150", percent(p.pck150))?;
            row(f, "  AUC", percent(p.auc))?;
            if let Some(root) = p.root_mm {
                row(f, "  pelvis in camera space", format!("{root:.0} mm"))?;
            }
        }
        for m in &self.mupots {
            let name = match m.protocol {
                Protocol::All => "MuPoTS-3D protocol, all",
                Protocol::Matched => "MuPoTS-3D protocol, matched",
            };
            let mut text = format!("3DPCK@150 {}, AUC {}", percent(m.pck150), percent(m.auc));
            if m.sequences > 1 {
                let mean = percent(m.pck150_per_sequence);
                text += &format!(", 3DPCK@150 mean of {} sequences {mean}", m.sequences);
            }
            row(f, name, text)?;
        }
        Ok(())
    }

    fn time(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let Some(i) = self.identity {
            row(f, "IDF1", percent(i.idf1))?;
            row(f, "  identity switches", i.switches)?;
            let seen = format!("{} of {}", i.matched, i.truth);
            row(f, "  appearances found", seen)?;
            let text = format!(
                "{} for {} people",
                i.predicted_identities, i.truth_identities
            );
            row(f, "  identities", text)?;
        }
        if let Some(j) = self.jitter {
            let truth = self
                .true_motion
                .map_or(String::new(), |t| format!(" (truth {t:.2})"));
            row(f, "mean joint acceleration", format!("{j:.2} m/s²{truth}"))?;
        }
        Ok(())
    }
}
