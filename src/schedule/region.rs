//! Which crop of the input the next picture takes, where everybody in view stands in less than all of it.
//!
//! The network's time goes by pixels. One person before a screen is in a third of a webcam's picture: that crop is
//! looked at, at the scale that all of it would have. All of it is looked at twice a second, and at once where
//! something else changes or somebody is missed.

use edgecap_client::message::Observation;

use super::change::Change;
use super::zoom::stature;
use crate::capture::{Brightness, Crop, Frame, Letterbox};

/// How long somebody may go unseen who comes where nothing seems to change.
const WHOLE_EVERY_NS: u64 = 500_000_000;
/// How long whole pictures are looked at after somebody was missed.
const DOUBT_NS: u64 = 600_000_000;
/// What of a person lies beyond the outermost joints, and what round them the network wants to see, statures.
const ROUND: f32 = 0.12;
/// Fewest pixels of the input round the outermost joints: a cell of the network's coarse layers has 16, and what it
/// says of one depends on those beside it.
const SURROUNDINGS: f32 = 32.0;
/// How fast the outermost joints may go, statures per second: a quick hand.
const SPEED: f32 = 2.0;
/// A larger crop of the input saves too little.
const MOST: f32 = 0.8;
/// The crop stays as large as it is while it has no more than so many times the pixels that it needs: every size has
/// buffers of its own.
const SPARE: f32 = 1.3;
/// Fewest pixels of a side.
const LEAST: usize = 64;
/// Of so many columns, and rows, of the picture one tells whether it changes.
const EVERY: usize = 2;
/// Sides of crops are multiples of so many steps of the network's input.
const STEPS: usize = 2;

/// The input of which a crop may be taken.
#[derive(Debug, Clone, Copy)]
pub struct Input {
    /// Pixels across and down.
    pub size: (usize, usize),
    /// What sides of the network's inputs are multiples of.
    pub step: usize,
    /// Where the picture lies in it.
    pub letterbox: Letterbox,
}

/// Where people are, and when all of a picture was looked at.
#[derive(Debug, Default)]
pub struct Region {
    /// The last picture that was looked at; `None` asks for a whole one.
    last: Option<Seen>,
    /// How many people it showed.
    people: usize,
    whole_ns: u64,
    /// Before then all of every picture is looked at.
    doubt_until_ns: u64,
    /// How large the crop was, pixels across and down.
    size: (usize, usize),
    /// Against the last picture that was looked at whole.
    change: Change,
    brightness: Brightness,
    /// Whether that is the brightness of the picture that is looked at.
    is_measured: bool,
    /// What crops have shown since then: its left, top, right and bottom, pixels of the picture.
    shown: Option<[f32; 4]>,
}

/// The people of a picture.
#[derive(Debug, Clone, Copy)]
struct Seen {
    ns: u64,
    /// The outermost joints' left, top, right and bottom, pixels of the picture.
    sides: [f32; 4],
    /// How tall the tallest is, pixels of the picture.
    stature: f32,
}

impl Region {
    /// The crop of `input` that a picture of a film is to be looked at by; `None` for all of it.
    pub fn crop(&mut self, frame: &Frame, input: &Input) -> Option<Crop> {
        self.is_measured = false;
        let crop = self.around(frame.time_ns, input)?;
        let near = input
            .letterbox
            .to_original(crop.left as f32, crop.top as f32);
        let (right, bottom) = (crop.left + crop.width, crop.top + crop.height);
        let far = input.letterbox.to_original(right as f32, bottom as f32);
        let now = [near[0], near[1], far[0], far[1]];
        // Where people were when all of it was looked at, something may have changed, too.
        let shown = self.shown.map_or(now, |shown| union(shown, now));
        self.measure(frame);
        let (columns, rows) = (self.brightness.columns, self.brightness.rows);
        let cells = |from: f32, to: f32, pixels: u32, cells: usize| {
            let cell = |at: f32| at * cells as f32 / pixels.max(1) as f32;
            cell(from).floor().max(0.0) as usize..cell(to).ceil().max(0.0) as usize
        };
        let columns = cells(shown[0], shown[2], frame.width, columns);
        let rows = cells(shown[1], shown[3], frame.height, rows);
        if self.change.is_beside(&self.brightness, columns, rows) {
            return None;
        }
        self.shown = Some(shown);
        self.size = (crop.width, crop.height);
        Some(crop)
    }

    /// The crop of `input` that shows everybody at `now` nanoseconds, if that saves enough.
    fn around(&self, now: u64, input: &Input) -> Option<Crop> {
        let last = self.last?;
        // A time that stands still does not tell how old the last whole picture is.
        let is_fresh = now > last.ns && now < self.whole_ns.saturating_add(WHOLE_EVERY_NS);
        if !is_fresh || now < self.doubt_until_ns {
            return None;
        }
        let seconds = (now - last.ns) as f32 * 1e-9;
        let reach = last.stature * (ROUND + SPEED * seconds) * input.letterbox.scale;
        let margin = reach.max(SURROUNDINGS);
        let [left, top, right, bottom] = last.sides;
        let [left, top] = input.letterbox.to_input(left, top);
        let [right, bottom] = input.letterbox.to_input(right, bottom);
        let across = Span::new(left - margin, right + margin, input.size.0, input.step);
        let down = Span::new(top - margin, bottom + margin, input.size.1, input.step);
        let area = |(w, h): (usize, usize)| (w * h) as f32;
        let needed = (across.side(), down.side());
        let suits = (needed.0..=input.size.0).contains(&self.size.0)
            && (needed.1..=input.size.1).contains(&self.size.1)
            && area(self.size) <= SPARE * area(needed);
        let (width, height) = if suits { self.size } else { needed };
        (area((width, height)) <= MOST * area(input.size)).then(|| Crop {
            left: across.first(width),
            top: down.first(height),
            width,
            height,
        })
    }

    /// Takes in who was seen in a picture, in all of it or a crop.
    pub fn seen(&mut self, frame: &Frame, people: &[Observation], is_whole: bool) {
        let now = frame.time_ns;
        if people.len() < std::mem::replace(&mut self.people, people.len()) {
            self.doubt_until_ns = now.saturating_add(DOUBT_NS);
        }
        // A clock that went backwards is a film that began again.
        if self.doubt_until_ns > now.saturating_add(DOUBT_NS) {
            self.doubt_until_ns = now;
        }
        self.last = seen(now, people);
        if is_whole {
            self.whole_ns = now;
            self.shown = None;
        }
        if is_whole && self.last.is_some() {
            if !self.is_measured {
                self.measure(frame);
            }
            self.change.compare_with(Some(self.brightness.clone()));
        }
    }

    /// The next picture is looked at as a whole.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// Measures how bright the green of a picture is.
    fn measure(&mut self, frame: &Frame) {
        let (width, height) = (frame.width as usize, frame.height as usize);
        let size = [width.div_ceil(EVERY), height.div_ceil(EVERY)];
        let (stride, step) = (EVERY * 3 * width, EVERY * 3);
        self.brightness.measure(&frame.rgb[1..], size, stride, step);
        self.is_measured = true;
    }
}

/// What holds both of two boxes: left, top, right, bottom.
fn union(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    [
        a[0].min(b[0]),
        a[1].min(b[1]),
        a[2].max(b[2]),
        a[3].max(b[3]),
    ]
}

/// Everybody's outermost joints. `None` where nobody is, or it is not known how large somebody is.
fn seen(ns: u64, people: &[Observation]) -> Option<Seen> {
    let mut sides = [
        f32::INFINITY,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NEG_INFINITY,
    ];
    let mut tallest = 0.0f32;
    for person in people {
        tallest = tallest.max(stature(person)?);
        // Those not seen are where the body has them, unless they are nowhere.
        let placed = person.joints2d.iter().filter(|j| j[..2] != [0.0, 0.0]);
        sides = placed.fold(sides, |sides, [u, v, _]| union(sides, [*u, *v, *u, *v]));
    }
    let is_placed = tallest > 0.0 && sides.iter().all(|s| s.is_finite());
    is_placed.then_some(Seen {
        ns,
        sides,
        stature: tallest,
    })
}

/// The whole steps of an input along one axis that cover something.
#[derive(Debug, Clone, Copy)]
struct Span {
    /// The first pixel, and that after the last.
    from: usize,
    to: usize,
    /// Pixels of the input.
    pixels: usize,
    step: usize,
}

impl Span {
    /// What lies from pixel `from` to pixel `to`, as far as it is within the input.
    fn new(from: f32, to: f32, pixels: usize, step: usize) -> Self {
        let first = (from.max(0.0) as usize / step * step).min(pixels - step);
        let end = (to.max(0.0) as usize + 1).div_ceil(step) * step;
        Self {
            from: first,
            to: end.clamp(first + step, pixels),
            pixels,
            step,
        }
    }

    /// How many pixels show it.
    fn side(self) -> usize {
        let unit = STEPS * self.step;
        let needed = (self.to - self.from).max(LEAST);
        (needed.div_ceil(unit) * unit).min(self.pixels)
    }

    /// The first of so many pixels that show it in their middle.
    fn first(self, side: usize) -> usize {
        let spare = side.saturating_sub(self.to - self.from) / 2;
        let before = spare / self.step * self.step;
        self.from.saturating_sub(before).min(self.pixels - side)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FRAME_NS: u64 = 33_333_333;
    const PICTURE: (u32, u32) = (1280, 720);

    fn input() -> Input {
        Input {
            size: (512, 288),
            step: 16,
            letterbox: Letterbox::fit(PICTURE.0, PICTURE.1, 512, 288),
        }
    }

    /// A grey picture taken at `ns`.
    fn frame(ns: u64) -> Frame {
        let (width, height) = PICTURE;
        Frame {
            width,
            height,
            rgb: vec![100; 3 * (width * height) as usize],
            time_ns: ns,
            ..Frame::default()
        }
    }

    /// Makes a box (left, top, right, bottom) of the picture lighter.
    fn lighten(frame: &mut Frame, [left, top, right, bottom]: [usize; 4]) {
        let width = frame.width as usize;
        for y in top..bottom {
            frame.rgb[3 * (width * y + left)..3 * (width * y + right)].fill(160);
        }
    }

    /// Somebody upright whose joints fill a box `height` pixels high round a place of the picture.
    fn person(u: f32, v: f32, height: f32) -> Observation {
        let mut o = Observation::default();
        let joints = o.joints2d.iter_mut().zip(&mut o.joints3d);
        for (k, (p, x)) in joints.enumerate() {
            let down = k as f32 / 13.0 - 0.5;
            let across = 0.3 * ((k % 3) as f32 - 1.0);
            *p = [u + across * height, v + down * height, 0.9];
            (x[0], x[1]) = (1.5 * across, 1.5 * down);
        }
        o
    }

    /// Plays pictures `k` in `0..n`, 30 a second, of these people; which crop each was looked at by.
    fn play(region: &mut Region, n: u64, people: &[Observation]) -> Vec<Option<Crop>> {
        let each = (0..n).map(|k| {
            let frame = frame(k * FRAME_NS);
            let crop = region.crop(&frame, &input());
            region.seen(&frame, people, crop.is_none());
            crop
        });
        each.collect()
    }

    #[test]
    fn one_person_is_looked_at_by_a_crop_and_all_of_it_twice_a_second() {
        let mut region = Region::default();
        let crops = play(&mut region, 90, &[person(640.0, 360.0, 400.0)]);
        let whole: Vec<usize> = (0..90).filter(|k| crops[*k].is_none()).collect();
        assert_eq!(whole, (0..90).step_by(16).collect::<Vec<_>>());
        for crop in crops.into_iter().flatten() {
            assert!(crop.area() < 512 * 288 / 2, "{crop:?}");
        }
    }

    #[test]
    fn nobody_people_everywhere_and_seldom_pictures_want_all_of_it() {
        let everywhere = [person(200.0, 360.0, 600.0), person(1100.0, 360.0, 600.0)];
        for people in [&[][..], &everywhere] {
            let crops = play(&mut Region::default(), 30, people);
            assert!(crops.iter().all(Option::is_none));
        }
        let (mut region, people) = (Region::default(), [person(640.0, 360.0, 400.0)]);
        for k in 0..9 {
            let frame = frame(k * 600_000_000);
            assert_eq!(region.crop(&frame, &input()), None);
            region.seen(&frame, &people, true);
        }
    }

    #[test]
    fn a_film_that_begins_again_is_looked_at_whole() {
        let (mut region, people) = (Region::default(), [person(640.0, 360.0, 400.0)]);
        assert!(play(&mut region, 3, &people)[2].is_some());
        assert_eq!(region.crop(&frame(0), &input()), None);
        // Also where somebody was missed before its end.
        region.seen(&frame(1_000_000_000), &people, true);
        region.seen(&frame(1_000_000_000 + FRAME_NS), &[], false);
        let crops = play(&mut region, 10, &people);
        assert!(crops[1..9].iter().all(Option::is_some), "{crops:?}");
    }

    #[test]
    fn who_is_missed_is_looked_for_in_all_of_it() {
        let mut region = Region::default();
        let both = [person(600.0, 360.0, 300.0), person(700.0, 360.0, 300.0)];
        assert!(play(&mut region, 2, &both)[1].is_some());
        let missed = frame(2 * FRAME_NS);
        region.seen(&missed, &both[..1], false);
        for k in 3..20 {
            let frame = frame(k * FRAME_NS);
            assert_eq!(region.crop(&frame, &input()), None, "picture {k}");
            region.seen(&frame, &both[..1], true);
        }
        let later = frame(21 * FRAME_NS);
        assert!(region.crop(&later, &input()).is_some());
    }

    #[test]
    fn who_is_missed_in_all_of_it_is_looked_for_in_the_next() {
        let mut region = Region::default();
        let both = [person(600.0, 360.0, 300.0), person(700.0, 360.0, 300.0)];
        assert!(play(&mut region, 2, &both)[1].is_some());
        region.seen(&frame(2 * FRAME_NS), &both[..1], true);
        assert_eq!(region.crop(&frame(3 * FRAME_NS), &input()), None);
    }

    #[test]
    fn where_times_stand_still_all_of_it_is_looked_at() {
        let (mut region, people) = (Region::default(), [person(640.0, 360.0, 400.0)]);
        for _ in 0..3 {
            assert_eq!(region.crop(&frame(FRAME_NS), &input()), None);
            region.seen(&frame(FRAME_NS), &people, true);
        }
    }

    #[test]
    fn what_changes_beside_the_crop_is_looked_at_at_once() {
        let people = [person(640.0, 360.0, 400.0)];
        for (changed, is_beside) in [
            ([600, 300, 700, 500], false),
            ([1100, 200, 1160, 400], true),
            ([10, 10, 40, 80], true),
            // Smaller than anybody.
            ([1100, 200, 1108, 208], false),
        ] {
            let mut region = Region::default();
            assert!(play(&mut region, 2, &people)[1].is_some());
            let mut picture = frame(2 * FRAME_NS);
            lighten(&mut picture, changed);
            let crop = region.crop(&picture, &input());
            assert_eq!(crop.is_none(), is_beside, "{changed:?}");
            region.seen(&picture, &people, crop.is_none());
            // It stays there: once all of it was looked at, that is nothing new.
            picture.time_ns += FRAME_NS;
            assert!(region.crop(&picture, &input()).is_some(), "{changed:?}");
        }
    }

    #[test]
    fn a_crop_stays_as_large_as_it_is_while_people_move_a_little() {
        let mut region = Region::default();
        let mut sizes = Vec::new();
        for k in 0..60 {
            let frame = frame(k * FRAME_NS);
            let crop = region.crop(&frame, &input());
            sizes.extend(crop.map(|p| (p.width, p.height)));
            let sway = 8.0 * (k as f32).sin();
            let people = [person(640.0 + sway, 360.0 - sway, 400.0 + sway)];
            region.seen(&frame, &people, crop.is_none());
        }
        sizes.dedup();
        assert!(sizes.len() <= 2, "{sizes:?}");
    }

    proptest! {
        #[test]
        fn a_crop_shows_everybody_and_lies_within_the_input(
            (u, v, height) in (-100.0f32..1400.0, -100.0f32..800.0, 30.0f32..500.0),
            step in prop::sample::select(&[16usize, 48][..]),
        ) {
            let size = (528 / step * step, 288 / step * step);
            let letterbox = Letterbox::fit(PICTURE.0, PICTURE.1, size.0 as u32, size.1 as u32);
            let input = Input { size, step, letterbox };
            let mut region = Region::default();
            let somebody = person(u, v, height);
            region.seen(&frame(0), &[somebody], true);
            if let Some(crop) = region.crop(&frame(FRAME_NS), &input) {
                let (right, bottom) = (crop.left + crop.width, crop.top + crop.height);
                prop_assert!(right <= size.0 && bottom <= size.1, "{crop:?}");
                for n in [crop.left, crop.top, crop.width, crop.height] {
                    prop_assert!(n.is_multiple_of(step), "{crop:?}");
                }
                prop_assert!(crop.area() as f32 <= MOST * (size.0 * size.1) as f32);
                for [u, v, _] in somebody.joints2d {
                    if (0.0..1280.0).contains(&u) && (0.0..720.0).contains(&v) {
                        let [x, y] = letterbox.to_input(u, v);
                        prop_assert!(x >= crop.left as f32 - 0.5 && x <= right as f32, "{crop:?} {x}");
                        prop_assert!(y >= crop.top as f32 - 0.5 && y <= bottom as f32, "{crop:?} {y}");
                    }
                }
            }
        }
    }
}
