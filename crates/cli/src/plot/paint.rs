//! Colours: the palette of Okabe and Ito, which readers with colour vision deficiencies tell apart.
//!
//! Every element carries its light colour as an attribute, so a figure is complete by itself, and a
//! class through which a page in dark mode replaces the colour.

use std::fmt::Write;

/// One colour of the figure in its light and its dark variant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Paint {
    pub class: &'static str,
    pub light: &'static str,
    pub dark: &'static str,
}

const fn paint(class: &'static str, light: &'static str, dark: &'static str) -> Paint {
    Paint { class, light, dark }
}

impl Paint {
    /// Behind everything.
    pub const PAPER: Paint = paint("paper", "#ffffff", "#161a1f");
    /// Titles, and whatever must be read first.
    pub const INK: Paint = paint("ink", "#1f2328", "#e8ebef");
    /// Tick labels and captions.
    pub const MUTED: Paint = paint("muted", "#59636e", "#9aa5b1");
    /// Lines of the grid.
    pub const GRID: Paint = paint("grid", "#e4e7eb", "#2a3038");
    /// The frame around a plot.
    pub const FRAME: Paint = paint("frame", "#8c959f", "#5f6a76");
    /// Things to fly around.
    const STONE: Paint = paint("stone", "#a7aeb7", "#5d6772");
    /// Their outlines.
    const STONE_EDGE: Paint = paint("stone-edge", "#6b747e", "#8f9aa6");
    /// The ground.
    const EARTH: Paint = paint("earth", "#d8cfc0", "#4a4438");
}

/// What a line or a bar stands for, by colour. Give the same thing the same colour in all figures
/// of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// Black on paper: what truly happened.
    Ink,
    /// Grey: what recedes, such as limits and references.
    Grey,
    /// The first choice among the colours.
    Blue,
    /// Warm and strong: what deserves attention.
    Vermillion,
    /// Calm: what is well.
    Green,
    /// A further colour.
    Orange,
    /// A further colour.
    Purple,
    /// A further colour; light, so fit for areas.
    Sky,
}

impl Colour {
    /// All colours, in the order in which to take them.
    pub const ALL: [Colour; 8] = [
        Colour::Ink,
        Colour::Grey,
        Colour::Blue,
        Colour::Vermillion,
        Colour::Green,
        Colour::Orange,
        Colour::Purple,
        Colour::Sky,
    ];

    pub(super) const fn paint(self) -> Paint {
        match self {
            Colour::Ink => Paint::INK,
            Colour::Grey => paint("grey", "#7d8790", "#8d97a1"),
            Colour::Blue => paint("blue", "#0072b2", "#3d9fdb"),
            Colour::Vermillion => paint("vermillion", "#d55e00", "#ee7a22"),
            Colour::Green => paint("green", "#009e73", "#1fbf92"),
            Colour::Orange => paint("orange", "#e69f00", "#f0b429"),
            Colour::Purple => paint("purple", "#cc79a7", "#d98fba"),
            Colour::Sky => paint("sky", "#56b4e9", "#7cc7f2"),
        }
    }
}

/// What a shape on a map stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fill {
    /// The ground; it does not widen the map.
    Ground,
    /// A thing to fly around.
    Obstacle,
    /// Room kept around a thing.
    Margin,
    /// A person.
    Person,
    /// A thing that the vehicle believes to stand.
    BelievedStill,
    /// A thing that the vehicle believes to move.
    BelievedMoving,
    /// A thing that the vehicle remembers and does not see, or knows too little of.
    BelievedUnseen,
    /// Bounds of where the centre of a thing may be.
    Uncertainty,
    /// The border of the permitted volume.
    Geofence,
}

/// How a shape is filled and outlined.
#[derive(Debug, Clone, Copy)]
pub(super) struct FillLook {
    pub name: &'static str,
    pub area: Paint,
    pub opacity: f64,
    pub edge: Paint,
    pub dash: &'static str,
}

impl Fill {
    /// All fills, from the one drawn first to the one drawn last.
    pub const ALL: [Fill; 9] = [
        Fill::Ground,
        Fill::Margin,
        Fill::Obstacle,
        Fill::Person,
        Fill::BelievedStill,
        Fill::BelievedMoving,
        Fill::BelievedUnseen,
        Fill::Uncertainty,
        Fill::Geofence,
    ];

    pub(super) const fn look(self) -> FillLook {
        let (name, area, opacity, edge, dash) = match self {
            Fill::Ground => ("ground", Paint::EARTH, 1.0, Paint::EARTH, ""),
            Fill::Obstacle => ("obstacle", Paint::STONE, 0.75, Paint::STONE_EDGE, ""),
            Fill::Margin => (
                "margin",
                Colour::Orange.paint(),
                0.15,
                Colour::Orange.paint(),
                "3 2",
            ),
            Fill::Person => (
                "person",
                Colour::Purple.paint(),
                0.65,
                Colour::Purple.paint(),
                "",
            ),
            Fill::BelievedStill => {
                let edge = Colour::Vermillion.paint();
                ("believed to stand", edge, 0.12, edge, "")
            }
            Fill::BelievedMoving => {
                let edge = Colour::Orange.paint();
                ("believed to move", edge, 0.3, edge, "")
            }
            Fill::BelievedUnseen => {
                let edge = Colour::Grey.paint();
                ("remembered, not seen", edge, 0.1, edge, "3 2")
            }
            Fill::Uncertainty => ("2 sigma of its place", Paint::INK, 0.0, Paint::INK, "1.5 2"),
            Fill::Geofence => {
                let edge = Colour::Green.paint();
                ("geofence", edge, 0.0, edge, "7 4")
            }
        };
        FillLook {
            name,
            area,
            opacity,
            edge,
            dash,
        }
    }
}

/// Style rules that give figures inlined in a page their dark colours.
pub fn dark_rules() -> String {
    let chrome = [Paint::PAPER, Paint::MUTED, Paint::GRID, Paint::FRAME];
    let shapes = Fill::ALL
        .iter()
        .flat_map(|fill| [fill.look().area, fill.look().edge]);
    let mut seen: Vec<Paint> = Vec::new();
    for paint in chrome
        .into_iter()
        .chain(Colour::ALL.map(Colour::paint))
        .chain(shapes)
    {
        if !seen.contains(&paint) {
            seen.push(paint);
        }
    }
    seen.iter()
        .fold(String::new(), |mut css, Paint { class, dark, .. }| {
            let _ = write!(
                css,
                "svg.plot .f-{class}{{fill:{dark}}}svg.plot .s-{class}{{stroke:{dark}}}"
            );
            css
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_colour_has_its_rule_in_dark_mode() {
        let css = dark_rules();
        for colour in Colour::ALL {
            assert!(css.contains(&format!(".s-{}{{", colour.paint().class)));
        }
        assert_eq!(css.matches(".f-vermillion{").count(), 1);
    }
}
