//! What a run leaves: bodies as arrays, as lines, as joints over time, as meshes, and the report.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Write};
use std::path::Path;

use super::read::Scene;
use super::store::{self, Store};
use glam::DVec3;

use crate::body::mesh::{MeshBody, Skin};
use crate::camera::View;
use crate::commands::empty;
use crate::commands::exit::Failure;
use crate::counted::counted;
use crate::export::{Axes, Format, MeshTrack, Take, encode, encode_meshes};
use crate::message::{Body, BodyFrame, FLAG_FILE_TIME, MAX_PEOPLE, World};
use crate::multiview::{MultiviewFit, MultiviewReport, ViewReport, bodies, world};
use crate::npz::{self, Array, Values};
use crate::output;
use crate::record::{BodiesRow, Row};

/// The file of the report.
const REPORT: &str = "report.json";
/// The file of the bodies as lines.
const LINES: &str = "bodies.jsonl";

/// Which frames get meshes.
pub enum Chosen {
    /// These.
    Some(Vec<usize>),
    /// Every one.
    All,
}

impl Chosen {
    /// Refuses frames that a run has not, before it is fitted.
    ///
    /// # Errors
    /// Naming the first.
    pub fn expect_within(&self, frames: usize) -> anyhow::Result<()> {
        let far = match self {
            Self::Some(all) => all.iter().find(|k| **k >= frames),
            Self::All => None,
        };
        far.map_or(Ok(()), |far| {
            let last = frames.saturating_sub(1);
            Err(Failure::usage(format!(
                "expected frames 0 to {last} for --obj, found {far}"
            ))
            .into())
        })
    }
}

/// Reads `--obj`.
///
/// # Errors
/// For anything but numbers and 'all'.
pub fn frames(text: Option<&str>) -> anyhow::Result<Chosen> {
    match text {
        None => Ok(Chosen::Some(Vec::new())),
        Some("all") => Ok(Chosen::All),
        Some(list) => {
            let each: Result<Vec<usize>, _> = list.split(',').map(|n| n.trim().parse()).collect();
            let wrong = || {
                Failure::usage(format!(
                    "expected frames such as 0,25,50 or 'all' for --obj, found {list}"
                ))
            };
            Ok(Chosen::Some(each.map_err(|_| wrong())?))
        }
    }
}

/// Refuses a folder that holds files or cannot be written, before any work is done; work that was broken off may lie
/// there.
///
/// # Errors
/// Exit code 73 when it does, or cannot be.
pub fn expect_empty(out: &Path) -> anyhow::Result<()> {
    empty::expect_empty(out, |e| {
        e.file_name() == store::NAME && store::is_one(&e.path())
    })?;
    Ok(output::try_place(&out.join(REPORT)).map_err(|e| Failure::output(out, &e))?)
}

/// Writes everything; it comes into the folder when it is complete, and the work that was kept for it goes. Returns the
/// bodies as a take.
///
/// # Errors
/// When it cannot be written.
pub fn run(
    (out, store): (&Path, Store),
    body: &MeshBody,
    scene: &Scene,
    fit: &MultiviewFit,
    report: &MultiviewReport,
    chosen: &Chosen,
) -> anyhow::Result<Take> {
    let folder = store.results()?;
    let put = |name: &str, bytes: &[u8]| -> anyhow::Result<()> {
        let path = folder.beside().join(name);
        std::fs::write(&path, bytes).map_err(|e| Failure::output(&out.join(name), &e).into())
    };
    put("bodies.npz", &arrays(fit)?)?;
    let path = folder.beside().join(LINES);
    let written = File::create(&path).map(BufWriter::new);
    let written = written.and_then(|mut to| {
        lines(&mut to, scene, fit, report)?;
        to.flush()?;
        File::open(&path)
    });
    let written = written.map_err(|e| Failure::output(&out.join(LINES), &e))?;
    let take = Take::read(BufReader::new(written), LINES)?;
    for file in encode(&take, Format::Trc, Path::new("joints.trc"))? {
        let mut bytes = Vec::new();
        file.write(&mut bytes)?;
        put(&file.path.display().to_string(), &bytes)?;
    }
    put("meshes.glb", &meshes(body, scene, fit, &take)?)?;
    for person in &fit.people {
        for f in &person.frames {
            let wanted = match chosen {
                Chosen::All => true,
                Chosen::Some(all) => all.contains(&f.frame),
            };
            if wanted {
                put(
                    &format!("person{}_{:06}.obj", person.id, f.frame),
                    obj(body, f).as_bytes(),
                )?;
            }
        }
    }
    let mut text = serde_json::to_string_pretty(report)?;
    text.push('\n');
    put(REPORT, text.as_bytes())?;
    folder.finish().map_err(|e| Failure::output(out, &e))?;
    // Before the work is gone its results are on the disk.
    match File::open(out).and_then(|f| Ok(rustix::fs::syncfs(f)?)) {
        Ok(()) => store.remove(),
        Err(e) => store.say_left(&e),
    }
    Ok(take)
}

/// SMPL's names, a row a frame of a person: `poses` [n, 72], `trans` [n, 3], `betas` [n, 10], and whose frame it is.
fn arrays(fit: &MultiviewFit) -> std::io::Result<Vec<u8>> {
    let (mut poses, mut trans, mut betas, mut ids, mut frames) =
        (vec![], vec![], vec![], vec![], vec![]);
    let mut width = 0;
    for person in &fit.people {
        for f in &person.frames {
            for q in f.body.pose.rotations {
                let q = if q.w < 0.0 { -q } else { q };
                poses.extend(q.to_scaled_axis().as_vec3().to_array());
            }
            // SMPL turns a body about its pelvis at rest and then moves it.
            let moved = f.body.pose.pelvis - f.body.person.joints()[0];
            trans.extend(moved.as_vec3().to_array());
            width = person.betas.len();
            betas.extend(person.betas.iter().map(|b| *b as f32));
            ids.push(i64::from(person.id));
            frames.push(f.frame as i64);
        }
    }
    let n = ids.len();
    let array = |name, shape, data| Array { name, shape, data };
    let row = [n];
    npz::write(&[
        array("poses", &[n, 72], Values::F32(&poses)),
        array("trans", &[n, 3], Values::F32(&trans)),
        array("betas", &[n, width], Values::F32(&betas)),
        array("ids", &row, Values::I64(&ids)),
        array("frames", &row, Values::I64(&frames)),
    ])
}

/// What lines of bodies have no room for, in words.
pub fn crowded(fit: &MultiviewFit) -> Option<String> {
    let mut people: HashMap<usize, usize> = HashMap::new();
    for f in fit.people.iter().flat_map(|p| &p.frames) {
        *people.entry(f.frame).or_default() += 1;
    }
    let crowded = people.values().filter(|n| **n > MAX_PEOPLE).count();
    (crowded > 0).then(|| {
        format!(
            "more than {MAX_PEOPLE} people in {}: {LINES}, joints.trc and exports hold the first {MAX_PEOPLE} of each, bodies.npz and meshes.glb all",
            counted(crowded as u64, "frame", "frames")
        )
    })
}

/// Which of the frames that are to get meshes have nobody, in words.
pub fn without_mesh(fit: &MultiviewFit, chosen: &Chosen) -> Option<String> {
    let Chosen::Some(chosen) = chosen else {
        return None;
    };
    let all = || fit.people.iter().flat_map(|p| &p.frames);
    let is_empty = |k: &&usize| all().all(|f| f.frame != **k);
    let empty: BTreeSet<usize> = chosen.iter().filter(is_empty).copied().collect();
    let names: Vec<String> = empty.iter().map(usize::to_string).collect();
    let frames = match names.len() {
        0 => return None,
        1 => "frame",
        _ => "frames",
    };
    Some(format!(
        "nobody is in {frames} {}: --obj writes no mesh there",
        names.join(", ")
    ))
}

fn lines(
    to: &mut impl Write,
    scene: &Scene,
    fit: &MultiviewFit,
    report: &MultiviewReport,
) -> io::Result<()> {
    let mut by_frame: Vec<Vec<Body>> = vec![Vec::new(); scene.frames.len()];
    for (person, line) in fit.people.iter().zip(&report.people) {
        for (frame, b) in bodies(person, line.stature_m, scene.rate) {
            by_frame[frame].push(b);
        }
    }
    // Views that are only measured tell nothing.
    let used = scene.views.iter().zip(&fit.weights);
    let used = used.filter(|(_, weight)| **weight > 0.0);
    let used: Vec<View> = used.map(|(view, _)| view.clone()).collect();
    let world = match scene.in_world {
        true => world(&used),
        false => World::default(),
    };
    for (k, people) in by_frame.iter().enumerate() {
        let mut frame = BodyFrame {
            sequence: k as u64,
            capture_ns: scene.times[k],
            pose_ns: scene.times[k],
            flags: match scene.of_machine {
                true => 0,
                false => FLAG_FILE_TIME,
            },
            count: people.len().min(MAX_PEOPLE) as u32,
            frame_total: scene.frames.len() as u32,
            world,
            ..BodyFrame::default()
        };
        for (slot, b) in frame.bodies.iter_mut().zip(people) {
            *slot = *b;
        }
        if let [view] = &scene.views[..] {
            (frame.width, frame.height) = (view.size[0], view.size[1]);
            frame.intrinsics = view.intrinsics();
            for b in &mut frame.bodies[..people.len().min(MAX_PEOPLE)] {
                for (seen, p) in b.joints2d.iter_mut().zip(b.joints3d) {
                    let pixel = view.project(DVec3::from(p.map(f64::from)));
                    *seen = pixel.map_or([0.0; 2], |p| p.as_vec2().to_array());
                }
            }
        }
        serde_json::to_writer(&mut *to, &BodiesRow::new(&frame, ""))?;
        to.write_all(b"\n")?;
    }
    Ok(())
}

/// Everybody's mesh on SMPL's tree, moving.
fn meshes(
    body: &MeshBody,
    scene: &Scene,
    fit: &MultiviewFit,
    take: &Take,
) -> anyhow::Result<Vec<u8>> {
    let time = |frame: usize| (scene.times[frame] - scene.times[0]) as f64 * 1e-9;
    let tracks: Vec<MeshTrack<'_>> = fit
        .people
        .iter()
        .filter_map(|person| {
            let frames = person.frames.iter();
            Some(MeshTrack {
                id: person.id,
                person: &person.frames.first()?.body.person,
                poses: frames.map(|f| (time(f.frame), &f.body.pose)).collect(),
            })
        })
        .collect();
    let axes = Axes::of(take);
    let end = scene.times.len().checked_sub(1).map_or(0.0, time);
    Ok(encode_meshes(body, &tracks, &axes, scene.rate, end)?)
}

fn obj(body: &MeshBody, f: &crate::multiview::PersonFrame) -> String {
    let mut skin = Skin::new(body, &f.body.person);
    let mut vertices = Vec::new();
    skin.pose(body, &f.body.pose, &f.body.posed, &mut vertices);
    let mut text = String::new();
    for v in vertices {
        let _ = writeln!(text, "v {:.5} {:.5} {:.5}", v.x, v.y, v.z);
    }
    for [a, b, c] in body.faces() {
        let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    text
}

/// A view that sees fewer than one in so many of those whom it should see is doubted.
const FEW: usize = 10;

/// Whether a view sees hardly anybody whom the others see, of those who stand in its picture; where nobody does, of all
/// whom it tells of, as its calibration may be why. Bystanders behind them prove nothing.
fn is_doubted(view: &ViewReport) -> bool {
    let wanted = match view.shown {
        0 => view.told,
        shown => shown.min(view.told),
    };
    view.sights * FEW < wanted
}

/// The report for people.
pub fn table(report: &MultiviewReport) -> String {
    let is_masked = report.views.iter().any(|v| v.contours.is_some());
    let mut text =
        "camera              weight  sights  median px  mean px  median %  mean %".to_owned();
    text.push_str(if is_masked { "  contours\n" } else { "\n" });
    let number = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    for v in &report.views {
        let _ = writeln!(
            text,
            "{:<18}  {:>6.2}  {:>6}  {:>9}  {:>7}  {:>8}  {:>6}{}{}",
            v.name,
            v.weight,
            v.sights,
            number(v.median_px),
            number(v.mean_px),
            number(v.median_percent),
            number(v.mean_percent),
            v.contours.map_or_else(String::new, |n| format!("  {n:>8}")),
            match v.weight {
                0.0 => "  held out",
                w if w < 1.0 => "  disagrees with the others and counts less",
                _ if is_doubted(v) => "  sees hardly any of the others' people; check its place",
                _ => "",
            }
        );
    }
    for p in &report.people {
        let _ = writeln!(
            text,
            "person {}: frames {}-{} ({} filled in), stature {:.2} m, {} exchanged limbs healed",
            p.id, p.first, p.last, p.filled, p.stature_m, p.exchanges_healed
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::body::mesh::{JOINTS, MeshPose};
    use crate::multiview::{PersonFit, PersonFrame};

    #[test]
    fn people_for_whom_lines_have_no_room_are_said() {
        let pose = MeshPose {
            pelvis: DVec3::ZERO,
            rotations: [DQuat::IDENTITY; JOINTS],
        };
        let person = |k: usize| PersonFit {
            id: k as u32 + 1,
            betas: vec![0.0; 10],
            // The last of them leaves after a frame.
            frames: (0..if k == MAX_PEOPLE { 1 } else { 2 })
                .map(|frame| PersonFrame::unseen(frame, pose))
                .collect(),
        };
        let of = |count: usize| MultiviewFit {
            people: (0..count).map(person).collect(),
            weights: Vec::new(),
        };
        assert_eq!(crowded(&of(MAX_PEOPLE)), None);
        let said = crowded(&of(MAX_PEOPLE + 1)).unwrap();
        assert!(said.contains("more than 32 people in 1 frame:"), "{said}");
    }

    #[test]
    fn frames_without_anybody_to_make_a_mesh_of_are_said() {
        let pose = MeshPose {
            pelvis: DVec3::ZERO,
            rotations: [DQuat::IDENTITY; JOINTS],
        };
        let fit = MultiviewFit {
            people: vec![PersonFit {
                id: 1,
                betas: vec![0.0; 10],
                frames: [3, 4, 6].map(|k| PersonFrame::unseen(k, pose)).into(),
            }],
            weights: Vec::new(),
        };
        let said = |frames: &str| without_mesh(&fit, &super::frames(Some(frames)).unwrap());
        assert_eq!(said("3,6"), None);
        assert_eq!(said("all"), None);
        let one = said("4,5").unwrap();
        assert!(one.starts_with("nobody is in frame 5:"), "{one}");
        let two = said("7,3,5,5").unwrap();
        assert!(two.starts_with("nobody is in frames 5, 7:"), "{two}");
    }
}
