//! Whose the rays of a detection are, and what a view counts.

use edgecap::body::mesh::MeshBody;
use edgecap::camera::View;
use edgecap::joints::HEAD_TOP;
use edgecap::lab::multiview::Trial;
use edgecap::lab::multiview::own::{RATE, Walker, observe, own, ring};
use edgecap::lab::synth::detector::Flaws;
use edgecap::message::Observation;
use edgecap::multiview::{Mask, MultiviewOptions, Run, Sight, fit, matched, stature, track};
use glam::DVec3;

/// What a spurious detection and a real person's make together lies on the real one's rays, and lives from them.
#[test]
fn a_ghost_takes_nothing_from_a_person() {
    let (views, person) = (ring(4), [Walker::new(1, 40, DVec3::ZERO)]);
    let mut filmed = views.clone();
    filmed[0].position.y += 0.06; // so its rays pass beside where the others see the person
    let seen =
        |by: &[View]| -> Vec<Vec<Observation>> { observe(by, &person, Flaws::NONE, 1).remove(0) };
    let sights: Vec<Vec<Sight>> = views
        .iter()
        .zip(seen(&filmed))
        .map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
        .collect();
    let mut frames = vec![sights; 20];
    // View 3 sees, once, what would lie on the person's rays of view 0 at 0.94 of their distance.
    let mut aside = views[3].clone();
    aside.position = filmed[0].position + (aside.position - views[0].position) / 0.94;
    let ghost = seen(&[aside]);
    frames[0][3].extend(ghost[0].iter().map(|o| Sight::new(&views[3], o)));
    let people = track(&views, &frames, RATE);
    assert_eq!(people.len(), 1);
    for (frame, moment) in &people[0].moments[4..] {
        let views = moment.sights.iter().flatten().count();
        assert_eq!(views, 4, "frame {frame}");
    }
}

#[test]
fn a_detection_is_held_against_one_body() {
    let places = [DVec3::new(-0.25, 0.0, 0.0), DVec3::new(0.25, 0.0, 0.1)];
    let people = [0, 1].map(|k| Walker::new(1, 30 + k, places[k as usize]));
    let (views, joints) = (ring(1), people.each_ref().map(|p| p.joints[HEAD_TOP]));
    let seen = observe(&views, &people[1..], Flaws::NONE, 1);
    let seen: Vec<Sight> = seen[0][0]
        .iter()
        .map(|o| Sight::new(&views[0], o))
        .collect();
    let found = matched(&views[0], &seen, &joints);
    assert!(found[0].is_none() && found[1].is_some());
    assert_eq!(matched(&views[0], &[], &joints), [None, None]);
    assert!(matched(&views[0], &seen, &[]).is_empty());
}

/// What views saw, in the order of the frames.
fn sights(trial: &Trial) -> Vec<Vec<Vec<Sight>>> {
    let of_frame = |seen: &Vec<Vec<Observation>>| {
        let each = trial.views.iter().zip(seen);
        each.map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
            .collect()
    };
    trial.seen.iter().map(of_frame).collect()
}

/// A camera that was zoomed in after its calibration sees people larger than they are.
#[test]
fn a_view_that_counts_less_has_no_part_in_the_shape() {
    let mut trial = own(1, 3, 10, Flaws::NONE);
    let centre = trial.views[2].centre.as_vec2().to_array();
    let zoomed = trial.seen.iter_mut().flat_map(|views| &mut views[2]);
    for joint in zoomed.flat_map(|seen| &mut seen.joints2d) {
        for (place, middle) in joint.iter_mut().zip(centre) {
            *place = middle + 1.25 * (*place - middle);
        }
    }
    let (body, frames) = (MeshBody::shipped(), sights(&trial));
    let options = MultiviewOptions {
        rate: trial.rate,
        paths: false,
        hierarchy: true,
    };
    let fitted = |used: [bool; 3]| {
        let run = Run::new(None, &|_| ());
        let found = fit(body, &trial.views, &used, &frames, options, run);
        (found.weights[2], stature(body, &found.people[0].betas))
    };
    let ((weight, with), (_, without)) = (fitted([true; 3]), fitted([true, true, false]));
    println!("weight {weight:.3}, {with:.3} m, {without:.3} m without");
    assert!(weight < 0.3, "{weight}");
    assert!((with - without).abs() < 0.005, "{with} m, not {without} m");
}

/// Of two people, one of whom stands behind the other in a view, the one before has the outline there: where masks show
/// what is to be seen of the other, do not know whose it is, or show nothing of it.
#[test]
fn nobody_is_given_the_outline_of_whoever_stands_before_them() {
    const FRAMES: usize = 4;
    let views = ring(3);
    let people = [0.0, -1.1].map(|z| Walker::new(FRAMES, 7, DVec3::new(0.0, 0.0, z)));
    let trial = Trial {
        seen: observe(&views, &people, Flaws::NONE, 7),
        views,
        ..own(7, 1, 1, Flaws::NONE)
    };
    let shown = |frame: usize, view: usize, hidden: u8, unknown: Option<u8>| {
        let camera = &trial.views[view];
        let depth = |k: &usize| camera.to_camera(people[*k].poses[frame].pelvis).z;
        let mut order = [0, 1];
        order.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
        let mut all = people[0].mask(frame, camera);
        all.owners.fill(0);
        all.unknown = unknown;
        for k in order {
            let own = people[k].mask(frame, camera).owners;
            let is_hidden = view == 0 && k == order[0];
            let value = if is_hidden { hidden } else { 1 + k as u8 };
            for (to, _) in all.owners.iter_mut().zip(own).filter(|(_, own)| *own == 1) {
                *to = value;
            }
        }
        all
    };
    let options = MultiviewOptions {
        rate: trial.rate,
        paths: false,
        hierarchy: true,
    };
    let (body, frames) = (MeshBody::shipped(), sights(&trial));
    for (hidden, unknown) in [(2, None), (255, Some(255)), (0, None)] {
        let drawn: Vec<Vec<Mask>> = (0..FRAMES)
            .map(|k| (0..3).map(|v| shown(k, v, hidden, unknown)).collect())
            .collect();
        let masks = |frame: usize, view: usize| Some(drawn[frame][view].clone());
        let run = Run::new(Some(&masks), &|_| ());
        let found = fit(body, &trial.views, &[true; 3], &frames, options, run);
        assert_eq!(found.people.len(), 2);
        for person in &found.people {
            for f in &person.frames {
                let is_before = f.body.pose.pelvis.z > -0.3;
                let outlined: Vec<bool> = f.moment.contours.iter().map(Option::is_some).collect();
                let frame = f.frame;
                assert_eq!(outlined, [is_before, true, true], "{hidden}, frame {frame}");
            }
        }
    }
}
