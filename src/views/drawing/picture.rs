//! A drawing, as SVG or PNG.

use kuva::backend::png::PngBackend;
use kuva::backend::svg::SvgBackend;
use kuva::render::render::{Primitive, Scene};

use crate::formats::visible;

/// Pixels of a PNG for each unit of the SVG.
const DENSITY: f32 = 2.0;

/// A drawing.
pub struct Picture {
    scene: Scene,
}

impl Picture {
    /// The drawing of a charting crate's scene. Texts are shown as they are: to the crate, what is between two `$`
    /// would be a formula. Control characters, which XML cannot express, are shown as escapes.
    pub(super) fn new(mut scene: Scene) -> Self {
        for element in &mut scene.elements {
            if let Primitive::Text { content, .. } = element {
                *content = visible::line(content).replace(['\u{fffe}', '\u{ffff}'], "\u{fffd}").replace('$', "\\$");
            }
        }
        Self { scene }
    }

    /// The drawing as SVG, with its size and on white, an element a line.
    #[must_use]
    pub fn svg(&self) -> String {
        let mut text = SvgBackend::new().with_pretty(true).render_scene(&self.scene);
        if !text.ends_with('\n') {
            text.push('\n');
        }
        text
    }

    /// The drawing as PNG, two pixels for each unit of the SVG.
    ///
    /// # Errors
    /// Where it is too large.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        PngBackend::new().with_scale(DENSITY).render_scene(&self.scene)
    }
}
