//! Left and right.

use super::{of_one, run, walker};
use crate::scene::ring::{Spoil, views};

#[test]
fn a_view_that_takes_left_for_right_is_outvoted() {
    let person = walker(6);
    let views = views(3);
    let shutters = [(30.0, 0.0); 3];
    let see = |exchanged: bool| {
        let frames = run(
            &views,
            &shutters,
            std::slice::from_ref(&person),
            4.0,
            &|v, t| {
                Some(Spoil {
                    exchanged: exchanged && v == 1 && (t * 0.7).fract() > 0.4,
                    pixels: 3.0,
                    ..Spoil::default()
                })
            },
        );
        of_one(&frames, &person)
    };
    let [without, with] = [see(false), see(true)];
    println!(
        "{:.1} mm, with exchanges {:.1} mm",
        1e3 * without,
        1e3 * with
    );
    assert!(with < 1.3 * without + 0.003, "{without} {with}");
}

#[test]
fn shoulders_point_the_way_hips_do_whatever_most_views_say() {
    let person = walker(6);
    let frames = run(
        &views(3),
        &[(30.0, 0.0); 3],
        std::slice::from_ref(&person),
        3.0,
        &|v, _| {
            Some(Spoil {
                arms_exchanged: v < 2,
                pixels: 3.0,
                ..Spoil::default()
            })
        },
    );
    let off = of_one(&frames, &person);
    println!("arms exchanged in two of three views: {:.1} mm", 1e3 * off);
    assert!(off < 0.035, "{off}");
}
