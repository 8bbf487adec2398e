//! Several charts in one picture, with one legend.

use kuva::render::figure::{Figure, FigureLegendPosition};

use super::chart::Chart;
use super::picture::Picture;

/// Draws charts in rows of so many columns; all are of one size, and the legend of all is below them.
#[must_use]
pub fn grid(title: &str, charts: &[Chart], columns: usize, (width, height): (f64, f64)) -> Picture {
    let (plots, layouts) = charts.iter().map(Chart::parts).unzip();
    let figure = Figure::new(charts.len().div_ceil(columns), columns)
        .with_title(title)
        .with_cell_size(width, height)
        .with_plots(plots)
        .with_layouts(layouts)
        .with_shared_legend_position(FigureLegendPosition::BottomCenter);
    Picture::new(figure.render())
}
