//! A look at a turned picture: what it shows comes out as the upright one has it.

use edgecap_client::message::{Intrinsics, Observation, StageTimes};

use super::looks::sum;
use super::shapes::Shapes;
use crate::capture::{Frame, Mounting};
use crate::commands::pipeline::Pipeline;
use crate::detect::{Lately, SIDES, join_turned, leaning, lone_lying_score};
use crate::schedule::inputs::{Quality, photo_inputs};
use crate::schedule::sides::Sides;

/// Looks at turned pictures, and their memory.
pub struct Turned {
    /// Of a film; of photos nobody knows who was there before.
    film: Option<Film>,
    picture: Frame,
    spare: Vec<u8>,
    people: Vec<Observation>,
}

/// What looks at a turned picture came to.
pub struct Joined {
    /// Whether there were any.
    pub has_looked: bool,
    /// Whether they brought anybody whom the upright look has not, or not as well.
    pub has_brought: bool,
    /// How long they took.
    pub times: StageTimes,
}

/// When pictures of a film are turned, and where people were in the last ones.
#[derive(Default)]
struct Film {
    sides: Sides,
    lately: Lately,
}

impl Turned {
    /// For a `film` (or camera), whose pictures follow each other, or for photos.
    pub fn new(film: bool) -> Self {
        Self {
            film: film.then(Film::default),
            picture: Frame::default(),
            spare: Vec::new(),
            people: Vec::new(),
        }
    }

    /// Adds to the `people` of the frame whom looks at it on its [`SIDES`] show. A photo is looked at on those that
    /// suit who leans in it, on both if nobody was found; the picture of a film on those that are worth it
    /// ([`Sides`]), and of whom only they show it counts who is where people were lately.
    ///
    /// # Errors
    /// As [`Pipeline::process`].
    pub fn join(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
        shapes: &mut Shapes,
        people: &mut Vec<Observation>,
    ) -> anyhow::Result<Joined> {
        let (now, leaning) = (frame.time_ns, leaning(people));
        let mut film = self.film.take();
        let wanted = match &mut film {
            Some(film) => film.sides.wanted(now, !people.is_empty(), leaning),
            None if people.is_empty() => [true; 2],
            None => leaning,
        };
        let (lone_score, most) = (shapes.any().lone_score(), shapes.any().max_people());
        let sizes = photo_inputs(
            (frame.height as usize, frame.width as usize),
            Quality::Balanced,
        );
        let (mut brought, mut times) = ([false; 2], StageTimes::default());
        for side in (0..SIDES.len()).filter(|side| wanted[*side]) {
            let stages = &mut shapes.of(sizes.clone())?[0];
            let (seen, took) = self.process(frame, intrinsics, SIDES[side], stages)?;
            let least = |p: &Observation| match &film {
                Some(film) if film.lately.is_near(p) => lone_score,
                Some(_) => f32::INFINITY,
                None => lone_lying_score(lone_score),
            };
            brought[side] = join_turned(people, seen, least, most);
            times = sum(times, took);
        }
        if let Some(film) = &mut film {
            film.sides.looked(now, wanted, brought);
            film.lately.seen(now, people);
        }
        self.film = film;
        Ok(Joined {
            has_looked: wanted.contains(&true),
            has_brought: brought.contains(&true),
            times,
        })
    }

    /// Everyone whom the `stages` see in the frame, turned clockwise by so many quarters, in pixels and camera axes of
    /// the frame as it is, and how long that took.
    ///
    /// # Errors
    /// As [`Pipeline::process`].
    fn process(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
        quarter_turns: u8,
        stages: &mut Pipeline,
    ) -> anyhow::Result<(&[Observation], StageTimes)> {
        let turn = Mounting {
            quarter_turns,
            mirrored: false,
        };
        (self.picture.width, self.picture.height) = (frame.width, frame.height);
        self.picture.rgb.clone_from(&frame.rgb);
        turn.apply(&mut self.picture, &mut self.spare);
        let lens = turn.intrinsics(*intrinsics, frame.width, frame.height);
        let seen = stages.process(&self.picture, &lens)?;
        let size = (self.picture.width, self.picture.height);
        self.people.clear();
        self.people
            .extend(seen.people.iter().map(|p| moved(p, turn.undoing(), size)));
        Ok((&self.people, seen.times))
    }
}

/// Somebody in a picture of this size (pixels across and down), as it is after a turn about the camera's axis.
fn moved(person: &Observation, turn: Mounting, size: (u32, u32)) -> Observation {
    let mut person = *person;
    for joint in &mut person.joints2d {
        // 0, 0 without confidence is no place.
        if *joint != [0.0; 3] {
            let [u, v] = turn.point([joint[0], joint[1]], size);
            (joint[0], joint[1]) = (u, v);
        }
    }
    for joint in &mut person.joints3d {
        let [x, y] = turn.direction([joint[0], joint[1]]);
        (joint[0], joint[1]) = (x, y);
    }
    person
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_and_the_turn_back_leave_everybody_as_they_were() {
        let mut person = Observation::default();
        for (j, joint) in person.joints2d.iter_mut().enumerate().skip(1) {
            *joint = [10.0 * j as f32, 100.0 - j as f32, 0.5];
        }
        for (j, joint) in person.joints3d.iter_mut().enumerate() {
            *joint = [0.01 * j as f32, -0.5 + 0.1 * j as f32, 0.3];
        }
        let size = (640, 480);
        for quarter_turns in 0..4 {
            let turn = Mounting {
                quarter_turns,
                mirrored: false,
            };
            let there = moved(&person, turn, size);
            let back = moved(&there, turn.undoing(), turn.size(size.0, size.1));
            assert_eq!(there.joints2d[0], [0.0; 3], "no place stays none");
            assert_eq!(back, person, "{quarter_turns}");
        }
    }

    #[test]
    fn who_leans_stands_upright_on_the_side_that_is_asked_for() {
        for degrees in [65.0f32, 90.0, -65.0, -90.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let mut person = Observation::default();
            for (j, joint) in person.joints2d.iter_mut().enumerate() {
                let down = 20.0 * j as f32;
                *joint = [300.0 - down * sin, 200.0 + down * cos, 0.9];
            }
            let [right, left] = leaning(&[person]);
            assert_ne!(right, left, "{degrees}");
            let turn = Mounting {
                quarter_turns: SIDES[usize::from(left)],
                mirrored: false,
            };
            let turned = moved(&person, turn, (640, 480));
            assert_eq!(leaning(&[turned]), [false; 2], "{degrees}");
        }
    }

    #[test]
    fn joints_in_the_round_turn_as_their_places_in_the_picture() {
        let lens = Intrinsics {
            fx: 500.0,
            fy: 510.0,
            cx: 300.0,
            cy: 200.0,
        };
        let size = (640, 480);
        // Joints three metres away, seen where they are.
        let mut person = Observation::default();
        for j in 0..person.joints2d.len() {
            let [x, y, z] = [0.1 * j as f32 - 0.7, 0.4 - 0.05 * j as f32, 3.0];
            person.joints3d[j] = [x, y, z];
            let (u, v) = (lens.cx + lens.fx * x / z, lens.cy + lens.fy * y / z);
            person.joints2d[j] = [u, v, 0.9];
        }
        for quarter_turns in 1..4 {
            let turn = Mounting {
                quarter_turns,
                mirrored: false,
            };
            let lens = turn.intrinsics(lens, size.0, size.1);
            let there = moved(&person, turn, size);
            for (seen, [x, y, z]) in there.joints2d.iter().zip(there.joints3d) {
                let (u, v) = (lens.cx + lens.fx * x / z, lens.cy + lens.fy * y / z);
                assert!((seen[0] - u).abs() < 1e-3 && (seen[1] - v).abs() < 1e-3);
            }
        }
    }
}
