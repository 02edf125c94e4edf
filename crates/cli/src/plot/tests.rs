//! Facts about whole figures.

use resvg::tiny_skia::Pixmap;
use resvg::usvg::{Options, Tree};

use super::*;

fn wave(points: usize) -> Series {
    let point = |i| {
        let x = f64::from(i) / points as f64;
        (60.0 * x, (20.0 * x).sin())
    };
    Series::new(
        "wave",
        Colour::Blue,
        (0..points as u32).map(point).collect(),
    )
}

fn chart() -> LineChart {
    LineChart {
        title: "A <wave> & its \"band\"".to_string(),
        x_label: "time (s)".to_string(),
        y_label: "height (m)".to_string(),
        series: vec![wave(1000)],
        bands: vec![Band {
            name: "3σ".to_string(),
            points: (0..100).map(|i| (0.6 * f64::from(i), -1.0, 1.0)).collect(),
            colour: Colour::Sky,
        }],
        markers: vec![Marker {
            x: 5.0,
            label: "take-off".to_string(),
            colour: Colour::Grey,
        }],
        ..LineChart::default()
    }
}

fn map() -> MapView {
    let pillar = Outline::Circle {
        centre: (10.0, 0.5),
        radius: 1.0,
    };
    MapView {
        title: "From above".to_string(),
        shapes: vec![MapShape::new(pillar, Fill::Obstacle).labelled("pillar")],
        paths: vec![wave(1000)],
        points: vec![MapPoint {
            at: (0.0, 0.0),
            label: "1".to_string(),
            glyph: Glyph::Waypoint,
        }],
        ..MapView::default()
    }
}

/// Draws the panel; an invalid document is an error here.
fn check_drawn(panel: &dyn Panel) -> Pixmap {
    let svg = panel.to_svg(500.0);
    Tree::from_str(&svg, &Options::default()).expect("valid SVG");
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    Pixmap::decode_png(&render_png(&svg, 500).unwrap()).unwrap()
}

#[test]
fn figures_are_valid_documents() {
    let (chart, map) = (chart(), map());
    let cell = |row| Cell {
        column: 0,
        row,
        columns: 1,
        rows: 1,
    };
    let figure = Figure {
        title: "All <of it>".to_string(),
        subtitle: "& more".to_string(),
        aspect: 1.0,
        columns: vec![1.0],
        rows: vec![1.0, 1.0],
        panels: vec![(cell(0), &chart as &dyn Panel), (cell(1), &map)],
    };
    check_drawn(&figure);
}

#[test]
fn the_picture_has_the_size_asked_for_and_is_not_blank() {
    let svg = chart().to_svg(500.0);
    let picture = Pixmap::decode_png(&render_png(&svg, 1000).unwrap()).unwrap();
    assert_eq!((picture.width(), picture.height()), (1000, 420));
    let blue = |rgb: (u8, u8, u8)| rgb.2 > 120 && rgb.0 < 60;
    let count = picture
        .pixels()
        .iter()
        .filter(|p| blue((p.red(), p.green(), p.blue())))
        .count();
    // The line is 1.6 pixels wide at half this size and crosses some 850 pixels.
    assert!(count > 2000, "{count} blue pixels");
}

#[test]
fn text_is_drawn_without_fonts_of_the_system() {
    let text = |content: &str| {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"100\" height=\"30\">\
             <text x=\"5\" y=\"20\" font-family=\"Nowhere\">{content}</text></svg>"
        )
    };
    assert_ne!(
        render_png(&text("flight"), 100).unwrap(),
        render_png(&text(""), 100).unwrap()
    );
}

#[test]
fn panels_without_data_are_drawn() {
    check_drawn(&LineChart::default());
    check_drawn(&MapView::default());
    check_drawn(&Bars::default());
}

#[test]
fn panels_of_broken_data_are_drawn() {
    let broken = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX];
    for value in broken {
        let series = Series::new("broken", Colour::Blue, vec![(value, value), (0.0, value)]);
        let points = vec![(0.0, value, value)];
        let band = Band {
            name: String::new(),
            points,
            colour: Colour::Sky,
        };
        let marker = Marker {
            x: value,
            label: "now".to_string(),
            colour: Colour::Grey,
        };
        let pillar = Outline::Circle {
            centre: (value, 0.0),
            radius: 1.0,
        };
        check_drawn(&LineChart {
            series: vec![series.clone()],
            bands: vec![band],
            markers: vec![marker],
            x_range: Some((0.0, value)),
            y_range: Some((value, value)),
            ..LineChart::default()
        });
        check_drawn(&MapView {
            shapes: vec![MapShape::new(pillar, Fill::Person).labelled("x")],
            paths: vec![series],
            points: vec![MapPoint {
                at: (value, 0.0),
                label: String::new(),
                glyph: Glyph::End,
            }],
            ..MapView::default()
        });
    }
}

#[test]
fn panels_smaller_than_their_labels_are_drawn() {
    for width in [1.0, 30.0, 90.0] {
        Tree::from_str(&chart().to_svg(width), &Options::default()).expect("valid SVG");
        Tree::from_str(&map().to_svg(width), &Options::default()).expect("valid SVG");
    }
}

#[test]
fn a_long_series_stays_small() {
    let chart = LineChart {
        series: vec![wave(500_000)],
        ..LineChart::default()
    };
    // Two points of at most 15 characters for each of 800 columns, and the axes.
    assert!(chart.to_svg(800.0).len() < 2 * 800 * 15 + 8000);
}

#[test]
fn a_gap_in_the_data_is_a_gap_in_the_line() {
    let mut series = Series {
        name: String::new(),
        ..wave(1000)
    };
    series.points[500].1 = f64::NAN;
    let svg = LineChart {
        series: vec![series],
        ..LineChart::default()
    }
    .to_svg(500.0);
    let line = svg.lines().find(|line| line.contains("s-blue")).unwrap();
    assert_eq!(line.matches('M').count(), 2);
}

#[test]
fn an_impossible_picture_is_refused() {
    let svg = chart().to_svg(500.0);
    assert!(matches!(render_png(&svg, 0), Err(PlotError::Size { .. })));
    assert!(matches!(
        render_png(&svg, 1 << 20),
        Err(PlotError::Size { .. })
    ));
    assert!(matches!(render_png("<svg", 10), Err(PlotError::Svg(_))));
}

#[test]
fn the_same_data_gives_the_same_bytes() {
    assert_eq!(map().to_svg(500.0), map().to_svg(500.0));
}
