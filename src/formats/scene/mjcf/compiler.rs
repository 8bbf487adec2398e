//! `<compiler>`: how the rest of a file of MJCF is meant.

use std::path::Path;

use super::super::pose::{Pose, from_axis, multiply};
use super::super::xml::Element;
use crate::formats::Diagnostic;

/// Attributes that say nothing about where things are, what they look like and what they weigh.
const IGNORED: [&str; 10] = [
    "autolimits",
    "texturedir",
    "boundinertia",
    "balanceinertia",
    "alignfree",
    "fitaabb",
    "fusestatic",
    "saveinertial",
    "usethread",
    "coordinate",
];

/// Attributes that change shapes and masses in ways that are not read, with the value that changes nothing.
const REFUSED: [(&str, &str, &str); 3] = [
    ("settotalmass", "-1", "scales all masses"),
    ("discardvisual", "false", "removes geoms that never collide"),
    ("inertiagrouprange", "0 5", "leaves out masses of geoms"),
];

/// Where the mass of a body is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Weighed {
    /// In `<inertial>`, and without one in the geoms.
    Either,
    Geoms,
    Inertial,
}

/// What holds for the whole file.
pub(super) struct Compiler {
    degrees: bool,
    /// The axes of Euler angles, one turn after the other. Capital letters are axes that are not turned with the body.
    sequence: [u8; 3],
    /// Of files of meshes.
    folder: String,
    /// Whether files are named without their folders.
    strips: bool,
    weighed: Weighed,
    least_mass: f64,
}

impl Default for Compiler {
    fn default() -> Self {
        Self {
            degrees: true,
            sequence: *b"xyz",
            folder: String::new(),
            strips: false,
            weighed: Weighed::Either,
            least_mass: 0.0,
        }
    }
}

impl Compiler {
    /// Reads an element; what it does not say stays.
    pub(super) fn read(&mut self, element: Element<'_>) -> Result<(), Diagnostic> {
        let read = ["angle", "eulerseq", "meshdir", "assetdir", "strippath", "inertiafromgeom", "boundmass"];
        element.only_attributes(&[&read[..], &REFUSED.map(|(name, ..)| name), &IGNORED].concat())?;
        check(element)?;
        match element.attribute("angle") {
            None => {}
            Some("degree") => self.degrees = true,
            Some("radian") => self.degrees = false,
            Some(_) => return Err(element.wrong_attribute("angle", "expected `degree` or `radian`")),
        }
        if let Some(letters) = element.attribute("eulerseq") {
            self.sequence = sequence(letters)
                .ok_or_else(|| element.wrong_attribute("eulerseq", "expected three letters of `xyzXYZ`, like `zyx`"))?;
        }
        let folder = element.attribute("meshdir").or(element.attribute("assetdir"));
        if let Some(folder) = folder.filter(|folder| !folder.is_empty()) {
            self.folder = format!("{}/", folder.trim_end_matches('/'));
        }
        if let Some(strips) = element.attribute("strippath") {
            self.strips = strips == "true";
        }
        match element.attribute("inertiafromgeom") {
            None => {}
            Some("auto") => self.weighed = Weighed::Either,
            Some("true") => self.weighed = Weighed::Geoms,
            Some("false") => self.weighed = Weighed::Inertial,
            Some(_) => return Err(element.wrong_attribute("inertiafromgeom", "expected `true`, `false` or `auto`")),
        }
        if let Some([mass]) = element.numbers("boundmass")? {
            self.least_mass = mass;
        }
        Ok(())
    }

    /// An angle in radians.
    pub(super) fn radians(&self, angle: f64) -> f64 {
        if self.degrees { angle.to_radians() } else { angle }
    }

    /// The rotation of three Euler angles.
    pub(super) fn turned(&self, angles: [f64; 3]) -> [f64; 4] {
        self.sequence.iter().zip(angles).fold(Pose::IDENTITY.rotation, |before, (letter, angle)| {
            let axis = match letter.to_ascii_lowercase() {
                b'x' => [1.0, 0.0, 0.0],
                b'y' => [0.0, 1.0, 0.0],
                _ => [0.0, 0.0, 1.0],
            };
            let turn = from_axis(axis, self.radians(angle));
            if letter.is_ascii_lowercase() { multiply(before, turn) } else { multiply(turn, before) }
        })
    }

    /// The file of a mesh.
    pub(super) fn file(&self, file: &str) -> String {
        let name = Path::new(file).file_name().and_then(|name| name.to_str()).filter(|_| self.strips).unwrap_or(file);
        if Path::new(name).is_absolute() { name.to_owned() } else { format!("{}{name}", self.folder) }
    }

    /// The mass of a body, of that in `<inertial>` and those of its geoms.
    pub(super) fn mass(&self, inertial: Option<f64>, geoms: &[f64]) -> Option<f64> {
        let sum = (!geoms.is_empty()).then(|| geoms.iter().sum());
        let mass = match self.weighed {
            Weighed::Either => inertial.or(sum),
            Weighed::Geoms => sum,
            Weighed::Inertial => inertial,
        };
        mass.map(|mass: f64| mass.max(self.least_mass))
    }
}

/// Refuses what would change the scene, and is not read.
fn check(element: Element<'_>) -> Result<(), Diagnostic> {
    for (name, nothing, effect) in REFUSED {
        if element.attribute(name).is_some_and(|value| value.trim() != nothing) {
            let message = format!("`{name}` {effect}, which is not read; expected `{nothing}`");
            return Err(element.wrong_attribute(name, message));
        }
    }
    if element.attribute("coordinate").is_some_and(|word| word != "local") {
        return Err(
            element.wrong_attribute("coordinate", "poses of this kind were given up by MuJoCo 2.3.4; expected `local`")
        );
    }
    Ok(())
}

fn sequence(letters: &str) -> Option<[u8; 3]> {
    let sequence: [u8; 3] = letters.as_bytes().try_into().ok()?;
    sequence.iter().all(|letter| b"xyzXYZ".contains(letter)).then_some(sequence)
}
