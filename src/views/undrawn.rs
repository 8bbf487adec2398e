//! No picture: this rmem is built without the feature `pictures`.

use super::chart::Chart;
use super::pictures::Undrawn;

/// A picture that cannot be made.
pub enum Picture {}

impl Picture {
    /// The drawing as SVG.
    #[must_use]
    pub fn svg(&self) -> String {
        match *self {}
    }

    /// The drawing as PNG.
    ///
    /// # Errors
    /// None: there is no picture.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        match *self {}
    }
}

impl Chart {
    /// Draws the chart.
    ///
    /// # Errors
    /// That rmem was built without pictures.
    pub fn draw(&self) -> Result<Picture, Undrawn> {
        Err(Undrawn)
    }
}

/// Draws charts in one picture.
///
/// # Errors
/// That rmem was built without pictures.
pub fn grid(_: &str, _: &[Chart], _: usize, _: (f64, f64)) -> Result<Picture, Undrawn> {
    Err(Undrawn)
}
