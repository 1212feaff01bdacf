//! What can be set on a camera: exposure, focus, power-line frequency and so on.

use std::io;

use v4l::v4l_sys as sys;
use v4l::v4l2::vidioc;

use super::{Camera, MAX_ENTRIES, ioctl, text, zeroed};

/// `V4L2_CTRL_FLAG_NEXT_CTRL`: the control after this one.
const NEXT: u32 = 0x8000_0000;
/// `V4L2_CTRL_FLAG_DISABLED`, `V4L2_CTRL_FLAG_READ_ONLY`.
const DISABLED: u32 = 0x1;
const READ_ONLY: u32 = 0x4;
/// `V4L2_CTRL_FLAG_INACTIVE`: without effect while another control (automatic exposure) decides.
const INACTIVE: u32 = 0x10;

/// `V4L2_CTRL_TYPE_*`.
const TYPE_INTEGER: u32 = 1;
const TYPE_BOOLEAN: u32 = 2;
const TYPE_MENU: u32 = 3;
const TYPE_BUTTON: u32 = 4;

/// What can be set on a camera.
#[derive(Debug, Default)]
pub(crate) struct Controls {
    pub found: Vec<Control>,
    /// Why the list may not be whole: the camera did not answer.
    pub broken_off: Option<io::Error>,
}

/// Something that can be set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Control {
    pub id: u32,
    pub name: String,
    pub kind: ControlKind,
    pub lowest: i32,
    pub highest: i32,
    pub step: i32,
    pub default: i32,
    /// Whether something else decides at the moment.
    pub inactive: bool,
}

/// What its values mean.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum ControlKind {
    Integer,
    Boolean,
    /// A value for every name that the driver takes.
    Menu(Vec<(i32, String)>),
    /// Set to do something once.
    Button,
}

impl Camera {
    /// Everything that can be set to one number.
    pub fn controls(&self) -> Controls {
        let mut controls = Controls::default();
        controls.broken_off = self.list_controls(&mut controls.found).err();
        controls
    }

    fn list_controls(&self, found: &mut Vec<Control>) -> io::Result<()> {
        let mut id = 0;
        for _ in 0..MAX_ENTRIES {
            // SAFETY: integers and arrays of integers: all-zero is valid. VIDIOC_QUERYCTRL takes a v4l2_queryctrl.
            let asked = unsafe {
                let mut query: sys::v4l2_queryctrl = zeroed();
                query.id = id | NEXT;
                ioctl(&self.handle, vidioc::VIDIOC_QUERYCTRL, &mut query).map(|()| query)
            };
            let query = match asked {
                Ok(query) => query,
                Err(e) if is_none(&e) => break,
                Err(e) => return Err(e),
            };
            if query.id <= id {
                // A driver that does not go on would keep us for ever.
                break;
            }
            id = query.id;
            let kind = match query.type_ {
                TYPE_INTEGER => ControlKind::Integer,
                TYPE_BOOLEAN => ControlKind::Boolean,
                TYPE_BUTTON => ControlKind::Button,
                TYPE_MENU => ControlKind::Menu(self.menu(id, query.minimum..=query.maximum)?),
                // Menus of numbers, texts, bit masks and headings nobody needs for a camera.
                _ => continue,
            };
            if query.flags & (DISABLED | READ_ONLY) == 0 {
                found.push(Control {
                    id,
                    name: text(&query.name),
                    kind,
                    lowest: query.minimum,
                    highest: query.maximum,
                    step: query.step,
                    default: query.default_value,
                    inactive: query.flags & INACTIVE != 0,
                });
            }
        }
        Ok(())
    }

    /// The choices of a menu; drivers leave some out.
    fn menu(
        &self,
        id: u32,
        values: std::ops::RangeInclusive<i32>,
    ) -> io::Result<Vec<(i32, String)>> {
        let choice = |value: i32| {
            let index = u32::try_from(value).ok()?;
            // SAFETY: integers and a union of such: all-zero is valid. VIDIOC_QUERYMENU takes a v4l2_querymenu. For
            // menus of names the member of the union is `name`, whose bytes may be any.
            let name = unsafe {
                let mut menu: sys::v4l2_querymenu = zeroed();
                menu.id = id;
                menu.index = index;
                ioctl(&self.handle, vidioc::VIDIOC_QUERYMENU, &mut menu)
                    .map(|()| menu.__bindgen_anon_1.name)
            };
            match name {
                Ok(name) => Some(Ok((value, text(&name)))),
                Err(e) if is_none(&e) => None,
                Err(e) => Some(Err(e)),
            }
        };
        values
            .take(MAX_ENTRIES as usize)
            .filter_map(choice)
            .collect()
    }

    /// What a control is set to.
    pub fn control(&self, id: u32) -> io::Result<i32> {
        let mut control = sys::v4l2_control { id, value: 0 };
        // SAFETY: VIDIOC_G_CTRL takes a v4l2_control.
        unsafe { ioctl(&self.handle, vidioc::VIDIOC_G_CTRL, &mut control)? };
        Ok(control.value)
    }

    /// Sets a control.
    pub fn set_control(&self, id: u32, value: i32) -> io::Result<()> {
        let mut control = sys::v4l2_control { id, value };
        // SAFETY: VIDIOC_S_CTRL takes a v4l2_control.
        unsafe { ioctl(&self.handle, vidioc::VIDIOC_S_CTRL, &mut control) }
    }
}

/// Whether a driver says that there is no such entry, or that it has no list: all else is a camera that did not answer.
fn is_none(error: &io::Error) -> bool {
    matches!(error.raw_os_error(), Some(libc::EINVAL | libc::ENOTTY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_does_not_answer_is_not_the_end_of_its_list() {
        let is_end = |code| is_none(&io::Error::from_raw_os_error(code));
        assert!(is_end(libc::EINVAL) && is_end(libc::ENOTTY));
        for code in [libc::EIO, libc::EPIPE, libc::ETIMEDOUT, libc::ENODEV] {
            assert!(!is_end(code), "{code}");
        }
    }
}
