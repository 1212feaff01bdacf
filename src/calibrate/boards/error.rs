//! What can be wrong with pictures of a board.

/// Fewest pictures that tell a lens.
pub const LEAST_PICTURES: usize = 5;

/// Why there is no calibration.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum BoardError {
    /// Too few pictures for a lens.
    #[error(
        "camera {camera}: expected the board in at least {LEAST_PICTURES} pictures, found it in {found} of {of}; take more, tilted both ways, near and far, in the corners as well"
    )]
    Few {
        /// The camera.
        camera: String,
        /// Pictures with the board.
        found: usize,
        /// Pictures.
        of: usize,
    },
    /// Corners of every picture lie on a line.
    #[error(
        "camera {0}: expected corners in two rows of the board or more, found those on one line alone in every picture \
         that is used, which do not tell where the board is; take pictures that show more of it"
    )]
    Line(String),
    /// Every board is square to the camera.
    #[error(
        "camera {camera}: expected the board tilted by 20 degrees and more in some pictures, found it too square to the camera in all {pictures}: they tell the focal length to {percent:.0} % only; tilt it both ways"
    )]
    Square {
        /// The camera.
        camera: String,
        /// Pictures that were used.
        pictures: usize,
        /// Uncertainty of the focal length, %.
        percent: f64,
    },
    /// Corners are not where any lens of the model has them.
    #[error(
        "camera {camera}: expected corners within {limit:.1} px of where a lens with Brown's distortion shows them, found them {px:.1} px off: a fisheye lens, whose pictures must be undistorted first, or a board that is not flat or another one{}",
        or_lens(*.is_given)
    )]
    Lens {
        /// The camera.
        camera: String,
        /// Root mean square, pixels.
        px: f64,
        /// What was allowed, pixels.
        limit: f64,
        /// Whether its lens was given.
        is_given: bool,
    },
    /// Nothing links a camera to the others.
    #[error(
        "camera {0}: expected the board in a picture at the same moment as in another camera's, found none in common; give pictures of one moment one name"
    )]
    NotLinked(String),
    /// Cameras contradict each other.
    #[error(
        "camera {camera}: expected common pictures that agree within {limit:.1} px, found {px:.1} px; pictures of one name must be of one moment, and the board must not move meanwhile{}",
        or_lens(*.is_given)
    )]
    Apart {
        /// The camera.
        camera: String,
        /// Root mean square, pixels.
        px: f64,
        /// What was allowed, pixels.
        limit: f64,
        /// Whether the lens of one of the cameras was given.
        is_given: bool,
    },
    /// Cameras saw the board that tells the floor in several places.
    #[error(
        "expected the board on the floor in one place in picture {picture}, within {limit:.1} px by all cameras, found {}; it must not move until all have taken the picture: name another, or take it again{}",
        all_off(.off),
        or_lens(*.is_given)
    )]
    Floor {
        /// The picture that tells the floor.
        picture: String,
        /// Cameras that saw it, and how far its corners are off, root mean square, pixels.
        off: Vec<(String, f64)>,
        /// What was allowed, pixels.
        limit: f64,
        /// Whether the lens of one of the cameras was given.
        is_given: bool,
    },
    /// The picture that tells the floor shows no board, or one that contradicts the others.
    #[error(
        "expected the board on the floor in picture {0} of some camera, found none that goes with the other pictures; name another, or take it again"
    )]
    NoFloor(String),
    /// A camera came out farther below the floor than the board on it may be tilted.
    #[error(
        "expected cameras above the floor, found {camera} {metres:.2} m below it; in picture {picture} the board must lie on the floor, face up"
    )]
    UnderFloor {
        /// The camera.
        camera: String,
        /// How far below.
        metres: f64,
        /// The picture that tells the floor.
        picture: String,
    },
}

/// What else may be wrong where a lens was given.
fn or_lens(is_given: bool) -> &'static str {
    match is_given {
        true => ", or a lens given by --lens is not its camera's at this zoom",
        false => "",
    }
}

/// How far corners are off in the pictures of these cameras.
fn all_off(all: &[(String, f64)]) -> String {
    let one = |(camera, px): &(String, f64)| format!("{px:.1} px off in camera {camera}");
    let each: Vec<String> = all.iter().map(one).collect();
    each.join(", ")
}
