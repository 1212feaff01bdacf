//! What views must be to each other: several, different, in metres, upright.

use super::Calibration;
use crate::camera::{CameraError, View};

/// Median distance between cameras above which it was given in millimetres.
const MILLIMETRES: f64 = 1000.0;
/// Median distance between cameras that no room has.
const FAR: f64 = 150.0;

/// Checks views of one file of which only the lenses are wanted.
///
/// # Errors
/// [`CameraError::Calibration`] for cameras of one name, or turned against their pictures.
pub fn check_lenses(name: &str, views: Vec<View>) -> Result<Calibration, CameraError> {
    lenses(name, &views)?;
    Ok(Calibration {
        views,
        notes: Vec::new(),
        alternative: None,
    })
}

fn lenses(name: &str, views: &[View]) -> Result<(), CameraError> {
    let wrong = |expected, found| {
        Err(CameraError::Calibration {
            file: name.to_owned(),
            expected,
            found,
        })
    };
    if views.is_empty() {
        return wrong("cameras", "none".into());
    }
    if let Some(found) = views.iter().find_map(turned) {
        return wrong("principal points near the middle of the pictures", found);
    }
    for (k, a) in views.iter().enumerate() {
        if views[..k].iter().any(|b| a.name == b.name) {
            return wrong("every camera once", format!("two called {}", a.name));
        }
    }
    Ok(())
}

/// Checks views of one file and brings them to metres.
///
/// # Errors
/// [`CameraError::Calibration`] for cameras that are the same, turned against their pictures, or in no unit that is
/// known.
pub fn check(name: &str, mut views: Vec<View>) -> Result<Calibration, CameraError> {
    let wrong = |expected, found| {
        Err(CameraError::Calibration {
            file: name.to_owned(),
            expected,
            found,
        })
    };
    lenses(name, &views)?;
    for view in &views {
        if !(view.position.is_finite() && view.rotation.is_finite()) {
            return wrong(
                "finite numbers",
                format!("a camera {} somewhere that is no place", view.name),
            );
        }
    }
    for (k, a) in views.iter().enumerate() {
        for b in &views[..k] {
            let apart = (a.position - b.position).length();
            let reach = 1e-6 * (1.0 + a.position.length());
            let same = apart <= reach
                && (a.rotation - b.rotation)
                    .to_cols_array()
                    .iter()
                    .all(|v| v.abs() < 1e-6);
            if same {
                let found = format!("{} and {} in one place with one direction", b.name, a.name);
                return wrong("every camera once", found);
            }
        }
    }
    let mut notes = Vec::new();
    let apart = spread(&views);
    if apart > MILLIMETRES {
        for view in &mut views {
            view.position *= 1e-3;
        }
        notes.push(format!(
            "{name}: cameras {apart:.0} apart: taken for millimetres, {:.2} m",
            apart * 1e-3
        ));
    } else if apart > FAR {
        let found = format!(
            "cameras {apart:.0} apart; divide translations by 1000 if these are millimetres, by 100 if centimetres"
        );
        return wrong("translations in metres", found);
    }
    Ok(Calibration {
        views,
        notes,
        alternative: None,
    })
}

/// Median distance between cameras; of one camera from the origin.
fn spread(views: &[View]) -> f64 {
    let mut apart: Vec<f64> = Vec::new();
    for (k, a) in views.iter().enumerate() {
        apart.extend(
            views[..k]
                .iter()
                .map(|b| (a.position - b.position).length()),
        );
    }
    if apart.is_empty() {
        return views[0].position.length();
    }
    apart.sort_by(f64::total_cmp);
    apart[apart.len() / 2]
}

/// What is wrong where a camera was calibrated with portrait pictures, or with others than it says.
fn turned(view: &View) -> Option<String> {
    if view.size == [0; 2] {
        return None;
    }
    let [w, h] = view.size.map(f64::from);
    let (upright, side) = (view.off_middle([w, h]), view.off_middle([h, w]));
    if upright < 0.25 {
        return None;
    }
    let ([w, h], centre, name) = (view.size, view.centre, &view.name);
    if side < 0.1 {
        return Some(format!(
            "camera {name} with pictures of {w}x{h} and centre {:.0}, {:.0}: calibrated for {h}x{w}, turned by 90 degrees; turn pictures or calibration",
            centre.x, centre.y
        ));
    }
    (upright > 0.5).then(|| {
        format!(
            "camera {name} with centre {:.0}, {:.0} outside pictures of {w}x{h}; check the size",
            centre.x, centre.y
        )
    })
}
