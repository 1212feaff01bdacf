//! Skeletons in characters: dots where the joints are, nothing outside the screen.

use edgecap::joints::BODY_JOINTS;
use edgecap::overlay::{Glyphs, Joint, Person, Screen, Skeleton, characters};
use proptest::prelude::*;

const BRAILLE: Screen = Screen {
    columns: 42,
    rows: 22,
    glyphs: Glyphs::Braille,
    coloured: false,
};
const BLOCKS: Screen = Screen {
    glyphs: Glyphs::Blocks,
    ..BRAILLE
};

/// Anything that can be drawn.
#[derive(Debug, Clone)]
struct Figure(Skeleton);

impl Person for Figure {
    fn skeleton(&self, _position: usize) -> Skeleton {
        self.0.clone()
    }
}

/// One bone.
fn bone(a: [f32; 2], b: [f32; 2], seen: bool) -> Figure {
    Figure(Skeleton {
        identity: 1,
        label: String::new(),
        joints: [a, b].map(|at| Some(Joint { at, seen })).to_vec(),
        bones: vec![(0, 1)],
    })
}

/// Dots that are set within the frame, as (x, y).
fn dots(lines: &[String], glyphs: Glyphs) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let inner = &lines[1..lines.len() - 1];
    for (row, line) in inner.iter().enumerate() {
        let cells: Vec<char> = line.chars().collect();
        for (column, c) in cells[1..cells.len() - 1].iter().enumerate() {
            match glyphs {
                Glyphs::Braille => {
                    let bits = (*c as u32).saturating_sub(0x2800);
                    // The pattern as Unicode draws it, row by row.
                    for (bit, (x, y)) in [(0, (0, 0)), (3, (1, 0)), (1, (0, 1)), (4, (1, 1))]
                        .into_iter()
                        .chain([(2, (0, 2)), (5, (1, 2)), (6, (0, 3)), (7, (1, 3))])
                    {
                        if bits >> bit & 1 == 1 {
                            found.push((2 * column + x, 4 * row + y));
                        }
                    }
                }
                Glyphs::Blocks => {
                    let halves: &[usize] = match c {
                        '▀' => &[0],
                        '▄' => &[1],
                        '█' => &[0, 1],
                        _ => &[],
                    };
                    found.extend(halves.iter().map(|y| (column, 2 * row + y)));
                }
            }
        }
    }
    found.sort_unstable();
    found
}

#[test]
fn a_bone_is_a_line_of_dots_between_its_joints() {
    // 80 by 80 dots of Braille, 40 by 40 half blocks, for a picture of 160 by 160.
    let upright = bone([41.0, 21.0], [41.0, 101.0], true);
    let lines = characters(std::slice::from_ref(&upright), [160, 160], BRAILLE);
    let expected: Vec<(usize, usize)> = (10..=50).map(|y| (20, y)).collect();
    assert_eq!(dots(&lines, Glyphs::Braille), expected);

    let level = bone([42.0, 22.0], [102.0, 22.0], true);
    let lines = characters(&[level], [160, 160], BLOCKS);
    let expected: Vec<(usize, usize)> = (10..=25).map(|x| (x, 5)).collect();
    assert_eq!(dots(&lines, Glyphs::Blocks), expected);
}

#[test]
fn bones_to_joints_out_of_sight_are_dotted() {
    let seen = characters(&[bone([41., 21.], [41., 101.], true)], [160, 160], BRAILLE);
    let guessed = characters(&[bone([41., 21.], [41., 101.], false)], [160, 160], BRAILLE);
    let count = |lines: &[String]| dots(lines, Glyphs::Braille).len();
    assert_eq!((count(&seen), count(&guessed)), (41, 21));
}

#[test]
fn bones_that_leave_the_picture_are_cut_at_its_edge() {
    let far = bone([41.0, 81.0], [4.1e9, 81.0], true);
    let lines = characters(&[far], [160, 160], BRAILLE);
    let expected: Vec<(usize, usize)> = (20..80).map(|x| (x, 40)).collect();
    assert_eq!(dots(&lines, Glyphs::Braille), expected);
    let outside = bone([-50.0, -50.0], [-50.0, 300.0], true);
    let lines = characters(&[outside], [160, 160], BRAILLE);
    assert_eq!(dots(&lines, Glyphs::Braille), []);
}

#[test]
fn heads_are_round_and_identities_named_and_coloured() {
    let mut joints = vec![None; BODY_JOINTS];
    let seen = |at| Some(Joint { at, seen: true });
    (joints[0], joints[16]) = (seen([80.5, 40.5]), seen([80.5, 60.5]));
    let head = Figure(Skeleton {
        identity: 3,
        label: "#3 0.91".to_owned(),
        joints,
        bones: Vec::new(),
    });
    let lines = characters(std::slice::from_ref(&head), [160, 160], BRAILLE);
    assert!(lines.iter().any(|l| l.contains("#3 ")), "{lines:#?}");
    assert!(!lines.iter().any(|l| l.contains("0.91")));
    // A circle of ten dots round (40, 30).
    for (x, y) in dots(&lines, Glyphs::Braille) {
        let from_centre = (x as f32 - 40.0).hypot(y as f32 - 30.0);
        assert!((from_centre - 10.0).abs() < 0.8, "({x}, {y})");
    }
    assert!(dots(&lines, Glyphs::Braille).len() > 40);

    let plain = |line: &String| !line.contains('\u{1b}');
    assert!(lines.iter().all(plain));
    let coloured = Screen {
        coloured: true,
        ..BRAILLE
    };
    let lines = characters(&[head], [160, 160], coloured);
    assert!(lines.iter().any(|l| l.contains("\u{1b}[38;5;")));
    assert!(lines.iter().any(|l| l.contains("#3")));
}

fn anywhere() -> impl Strategy<Value = Option<Joint>> {
    let pixel = prop_oneof![
        -50.0..2000.0_f32,
        prop::num::f32::ANY,
        Just(f32::INFINITY),
        Just(f32::NAN)
    ];
    let joint = ([pixel.clone(), pixel], any::<bool>()).prop_map(|(at, seen)| Joint { at, seen });
    prop::option::weighted(0.9, joint)
}

fn figure() -> impl Strategy<Value = Figure> {
    (any::<u32>(), prop::collection::vec(anywhere(), BODY_JOINTS)).prop_map(|(identity, joints)| {
        Figure(Skeleton {
            identity,
            label: format!("#{identity}?"),
            bones: (1..joints.len()).map(|j| (j, j - 1)).collect(),
            joints,
        })
    })
}

proptest! {
    #[test]
    fn no_line_is_longer_and_none_is_more_than_the_screen_has(
        people in prop::collection::vec(figure(), 0..4),
        size in [0..4000_u32, 0..4000_u32],
        columns in 0..200_usize,
        rows in 0..60_usize,
        blocks in any::<bool>(),
    ) {
        let glyphs = if blocks { Glyphs::Blocks } else { Glyphs::Braille };
        let screen = Screen { columns, rows, glyphs, coloured: false };
        let lines = characters(&people, size, screen);
        prop_assert!(lines.len() <= rows);
        let width = lines.first().map_or(0, |l| l.chars().count());
        prop_assert!(width <= columns);
        prop_assert!(lines.iter().all(|l| l.chars().count() == width));
        let room = columns > 2 && rows > 2 && size[0] > 0 && size[1] > 0;
        prop_assert_eq!(!lines.is_empty(), room);
    }
}
