//! Controls of a camera by name, as the user gives them: `exposure_time_absolute=200`.

use std::fmt;
use std::io;
use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::refusal::refused;
use super::v4l2::{Camera, Control, ControlKind, Controls};
use crate::capture::error::{CaptureError, name_of};

/// A wish: this control, set to that.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ControlSetting {
    /// The control's name, or its beginning: `exposure` for `exposure_time_absolute`.
    pub name: String,
    /// A number, `on`, `off`, or the name of a choice: `50 Hz`.
    pub value: String,
}

impl FromStr for ControlSetting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
                Ok(Self {
                    name: plain(name),
                    value: value.trim().to_owned(),
                })
            }
            _ => Err(format!(
                "'{text}': expected NAME=VALUE, such as power_line_frequency=1; --list-controls shows what this camera has"
            )),
        }
    }
}

impl TryFrom<String> for ControlSetting {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<ControlSetting> for String {
    fn from(setting: ControlSetting) -> Self {
        setting.to_string()
    }
}

impl fmt::Display for ControlSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.name, self.value)
    }
}

/// Small letters, digits and single underscores: `Exposure, Auto` → `exposure_auto`.
fn plain(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<String> = words
        .filter(|w| !w.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    words.join("_")
}

/// Of all controls the one of this name, or the only one whose name begins so.
fn find<'a>(controls: &'a [Control], name: &str) -> Result<&'a Control, String> {
    if let Some(exact) = controls.iter().find(|c| plain(&c.name) == name) {
        return Ok(exact);
    }
    let mut some = controls.iter().filter(|c| plain(&c.name).starts_with(name));
    match (some.next(), some.next()) {
        (Some(only), None) => Ok(only),
        (Some(a), Some(b)) => Err(format!(
            "expected the name of one control, '{name}' may be {} or {}",
            plain(&a.name),
            plain(&b.name)
        )),
        (None, _) => {
            let all: Vec<String> = controls.iter().map(|c| plain(&c.name)).collect();
            Err(format!(
                "this camera has no control '{name}'; it has {}",
                if all.is_empty() {
                    "none".into()
                } else {
                    all.join(", ")
                }
            ))
        }
    }
}

/// The number that a control takes for what the user wrote.
fn number(control: &Control, value: &str) -> Result<i32, String> {
    let wanted = plain(value);
    let number = match &control.kind {
        ControlKind::Boolean => match wanted.as_str() {
            "on" | "true" | "yes" => Some(1),
            "off" | "false" | "no" => Some(0),
            _ => None,
        },
        ControlKind::Menu(choices) => choices
            .iter()
            // "50Hz" is "50 Hz".
            .find(|(_, name)| plain(name).replace('_', "") == wanted.replace('_', ""))
            .map(|(number, _)| *number),
        ControlKind::Integer | ControlKind::Button => None,
    };
    let number = number.or_else(|| value.parse().ok());
    let taken = |n: &i32| match &control.kind {
        ControlKind::Menu(choices) => choices.iter().any(|(number, _)| number == n),
        ControlKind::Button => true,
        _ => (control.lowest..=control.highest).contains(n),
    };
    number.filter(taken).ok_or_else(|| {
        format!(
            "expected {} for {}, found '{value}'",
            values(control),
            plain(&control.name)
        )
    })
}

/// What a control takes, in words.
fn values(control: &Control) -> String {
    match &control.kind {
        ControlKind::Integer if control.step > 1 => format!(
            "{} to {} in steps of {}",
            control.lowest, control.highest, control.step
        ),
        ControlKind::Integer => format!("{} to {}", control.lowest, control.highest),
        ControlKind::Boolean => "on or off".into(),
        ControlKind::Menu(choices) => {
            let all: Vec<String> = choices
                .iter()
                .map(|(number, name)| format!("{number} ({name})"))
                .collect();
            all.join(", ")
        }
        ControlKind::Button => "anything".into(),
    }
}

/// Sets what the user wishes, in the order given: automatic exposure is switched off before an exposure is set.
///
/// # Errors
/// [`CaptureError::Config`] for a control or value that this camera does not have; else as [`refused`]: what a cable
/// does to one of many calls must not look like a mistake in the settings.
pub(super) fn apply(
    camera: &Camera,
    device: &str,
    wishes: &[ControlSetting],
) -> Result<(), CaptureError> {
    for wish in wishes {
        // Asked anew each time: one control makes another one active.
        let Controls { found, broken_off } = camera.controls();
        let control = find(&found, &wish.name).map_err(|why| match broken_off {
            Some(e) => refused(device, e),
            None => mistake(device, why),
        })?;
        let number = number(control, &wish.value).map_err(|why| mistake(device, why))?;
        camera
            .set_control(control.id, number)
            .map_err(|e| not_set(device, wish, e))?;
        if control.inactive {
            tracing::warn!(
                "{wish} has no effect while another control decides: switch the automatic one off before it"
            );
        }
    }
    Ok(())
}

fn mistake(device: &str, reason: String) -> CaptureError {
    CaptureError::Config {
        setting: device.to_owned(),
        reason,
    }
}

/// What a driver says against a value, and what has nothing to do with it.
fn not_set(device: &str, wish: &ControlSetting, error: io::Error) -> CaptureError {
    match error.raw_os_error() {
        Some(libc::EINVAL | libc::ERANGE | libc::EACCES) => mistake(
            device,
            format!("the camera refuses {wish} ({error}); try another value"),
        ),
        _ => refused(device, error),
    }
}

/// A line for every control of a camera: its name, what it is set to, what it takes.
///
/// # Errors
/// If the camera cannot be opened.
pub fn list_controls(path: &Path) -> Result<Vec<String>, CaptureError> {
    let name = name_of(path);
    let camera = Camera::open(path).map_err(|e| refused(&name, e))?;
    camera.capabilities().map_err(|e| refused(&name, e))?;
    let line = |control: Control| {
        let now = match camera.control(control.id) {
            Ok(value) => format!("={value}"),
            // Buttons have no value.
            Err(_) => String::new(),
        };
        let default = match control.kind {
            ControlKind::Button => String::new(),
            _ => format!(" [default {}]", control.default),
        };
        let inactive = if control.inactive {
            " (another control decides)"
        } else {
            ""
        };
        format!(
            "{}{now}  {}{default}{inactive}",
            plain(&control.name),
            values(&control)
        )
    };
    let Controls { found, broken_off } = camera.controls();
    if let Some(e) = broken_off {
        tracing::warn!("{name}: the camera does not name all of its controls ({e}); try again");
    }
    Ok(found.into_iter().map(line).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controls() -> Vec<Control> {
        let control = |name: &str, kind, lowest, highest, step| Control {
            id: 1,
            name: name.into(),
            kind,
            lowest,
            highest,
            step,
            default: lowest,
            inactive: false,
        };
        let menu = |names: &[&str]| {
            let choices = (0..).zip(names).map(|(i, n)| (i, (*n).to_owned()));
            ControlKind::Menu(choices.collect())
        };
        vec![
            control("Brightness", ControlKind::Integer, -64, 64, 1),
            control(
                "Exposure, Auto",
                menu(&["Auto Mode", "Manual Mode"]),
                0,
                3,
                1,
            ),
            control("Exposure (Absolute)", ControlKind::Integer, 50, 10_000, 5),
            control(
                "Power Line Frequency",
                menu(&["Disabled", "50 Hz", "60 Hz"]),
                0,
                2,
                1,
            ),
            control("Focus, Auto", ControlKind::Boolean, 0, 1, 1),
        ]
    }

    /// The name of the control and the number that it is set to.
    fn set(text: &str) -> Result<(String, i32), String> {
        let wish: ControlSetting = text.parse()?;
        let controls = controls();
        let control = find(&controls, &wish.name)?;
        Ok((control.name.clone(), number(control, &wish.value)?))
    }

    #[test]
    fn wishes_are_found_by_name_and_choice() {
        let ok = |text: &str, name: &str, value: i32| {
            assert_eq!(set(text), Ok((name.to_owned(), value)), "{text}");
        };
        ok("brightness=-3", "Brightness", -3);
        ok("exposure_auto=Manual Mode", "Exposure, Auto", 1);
        ok("Exposure (Absolute) = 200", "Exposure (Absolute)", 200);
        ok("power_line=50Hz", "Power Line Frequency", 1);
        ok("power_line_frequency=2", "Power Line Frequency", 2);
        ok("focus_auto=off", "Focus, Auto", 0);
        ok("focus=1", "Focus, Auto", 1);
    }

    #[test]
    fn only_a_value_that_the_driver_refuses_is_a_mistake_in_the_settings() {
        let wish: ControlSetting = "focus_auto=off".parse().unwrap();
        let not_set = |code| not_set("video0", &wish, io::Error::from_raw_os_error(code));
        for code in [libc::EINVAL, libc::ERANGE, libc::EACCES] {
            assert_eq!(not_set(code).exit_code(), 78, "{code}");
        }
        for code in [
            libc::EIO,
            libc::EPIPE,
            libc::ETIMEDOUT,
            libc::ENODEV,
            libc::EBUSY,
        ] {
            assert!(not_set(code).may_pass(), "{code}");
        }
    }

    #[test]
    fn what_the_camera_does_not_have_is_said_with_what_it_has() {
        let wrong = |text: &str, words: &[&str]| {
            let error = set(text).unwrap_err();
            for word in words {
                assert!(
                    error.contains(word),
                    "{text}: '{word}' is missing in: {error}"
                );
            }
        };
        wrong(
            "gain=3",
            &["no control 'gain'", "exposure_absolute", "brightness"],
        );
        wrong("exposure=3", &["exposure_auto", "exposure_absolute"]);
        wrong("brightness=65", &["-64 to 64", "65"]);
        wrong("exposure_abs=soon", &["in steps of 5", "soon"]);
        wrong("power_line=70 Hz", &["1 (50 Hz)", "70 Hz"]);
        wrong("focus=2", &["on or off"]);
        wrong("brightness", &["NAME=VALUE"]);
        wrong("=3", &["NAME=VALUE"]);
    }
}
