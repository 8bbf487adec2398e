//! Several charts in one picture, with one legend.

use kuva::render::figure::{Figure, FigureLegendPosition};

use super::picture::Picture;
use crate::views::chart::Chart;
use crate::views::pictures::Undrawn;

/// Draws charts in rows of so many columns; all are of one size, and the legend of all is below them.
///
/// # Errors
/// If rmem was built without pictures.
pub fn grid(title: &str, charts: &[Chart], columns: usize, (width, height): (f64, f64)) -> Result<Picture, Undrawn> {
    let (plots, layouts) = charts.iter().map(Chart::parts).unzip();
    let figure = Figure::new(charts.len().div_ceil(columns), columns)
        .with_title(title)
        .with_cell_size(width, height)
        .with_plots(plots)
        .with_layouts(layouts)
        .with_shared_legend_position(FigureLegendPosition::BottomCenter);
    Ok(Picture::new(figure.render()))
}
