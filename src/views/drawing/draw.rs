//! A chart as a picture.

use kuva::render::layout::{ComputedLayout, Layout};
use kuva::render::plots::Plot;
use kuva::render::render::render_multiple;

use super::frame::layout;
use super::labels::place;
use super::marks::marks;
use super::picture::Picture;
use crate::views::chart::{Chart, Kind};
use crate::views::pictures::Undrawn;

impl Chart {
    /// Draws the chart.
    ///
    /// # Errors
    /// If rmem was built without pictures.
    pub fn draw(&self) -> Result<Picture, Undrawn> {
        let (plots, mut layout) = self.parts();
        if self.kind != Kind::Map {
            return Ok(Picture::new(render_multiple(plots, layout)));
        }
        let (mut names, mut left_out) = place(self, &ComputedLayout::from_layout(&layout));
        if left_out > 0 {
            // The line about them takes space, too.
            layout = layout.with_subtitle("-");
            (names, left_out) = place(self, &ComputedLayout::from_layout(&layout));
            layout = layout.with_subtitle(format!("{left_out} names are left out: there is no room for them"));
        }
        let mut scene = render_multiple(plots, layout);
        names.into_iter().for_each(|name| scene.add(name));
        Ok(Picture::new(scene))
    }

    /// What the chart is made of, to be drawn alone or among others.
    pub(super) fn parts(&self) -> (Vec<Plot>, Layout) {
        let plots = marks(self);
        let layout = layout(self, &plots);
        (plots, layout)
    }
}
