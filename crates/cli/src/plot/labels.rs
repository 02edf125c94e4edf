//! Labels on a map, placed where they cover neither each other nor, if possible, a path.

use super::decimate::Px;
use super::paint::Paint;
use super::scale::Range;
use super::svg::{Anchor, Canvas, Rect, Type};
use super::text;

/// Size of labels on the map, in pixels.
const LABEL_SIZE: f64 = 10.0;

/// Where text and signs already stand, and which pixels paths pass.
pub(super) struct Places {
    area: Rect,
    taken: Vec<Rect>,
    trail: Vec<Px>,
}

impl Places {
    pub fn new(area: Rect, runs: &[Vec<Px>]) -> Self {
        let pairs = runs.iter().flat_map(|run| run.windows(2));
        let inside = |px: Px| area.holds(px);
        let near = pairs.filter(|pair| inside(pair[0]) || inside(pair[1]));
        let trail = near
            .flat_map(|pair| along(pair[0], pair[1]))
            .filter(|px| inside(*px));
        Places {
            area,
            taken: Vec::new(),
            trail: trail.collect(),
        }
    }

    /// Whether no path passes the place.
    fn calm(&self, place: &Rect) -> bool {
        !self.trail.iter().any(|px| place.holds(*px))
    }

    /// The first of the middles at which the label has room, if possible away from paths.
    fn choose(&self, candidates: &[Px], label: &str) -> Option<Px> {
        let free = |at: &&Px| self.free(&label_box(**at, label));
        let calm = |at: &&Px| self.calm(&label_box(**at, label));
        let free: Vec<&Px> = candidates.iter().filter(free).collect();
        free.iter()
            .copied()
            .find(calm)
            .or(free.first().copied())
            .copied()
    }

    pub fn take(&mut self, place: Rect) {
        self.taken.push(place);
    }

    fn free(&self, place: &Rect) -> bool {
        self.area.contains(place) && self.taken.iter().all(|taken| !taken.overlaps(place))
    }

    /// Writes a label beside a sign of this half width and height, wherever there is room.
    pub fn label_beside(&mut self, canvas: &mut Canvas, [x, y]: Px, half: [f64; 2], label: &str) {
        let beside = half[0] + 3.0 + 0.5 * text::width(label, LABEL_SIZE);
        let above = half[1] + 0.5 * LABEL_SIZE + 2.0;
        let candidates = [
            [x + beside, y],
            [x - beside, y],
            [x, y - above],
            [x, y + above],
            [x + beside, y - above],
            [x + beside, y + above],
            [x - beside, y - above],
            [x - beside, y + above],
        ];
        if let Some(at) = self.choose(&candidates, label) {
            self.write(canvas, at, label);
        }
    }

    /// Writes a label onto a shape of this extent in pixels, or beside a shape that is too small.
    pub fn label_shape(&mut self, canvas: &mut Canvas, x: Range, y: Range, label: &str) {
        let at = [x.centre(), y.centre()];
        let place = label_box(at, label);
        if place.width > x.span() || place.height > y.span() {
            self.label_beside(canvas, at, [0.5 * x.span(), 0.5 * y.span()], label);
        } else {
            let heights = [0.5, 0.25, 0.75].map(|part| y.low + part * y.span());
            let candidates = heights.map(|height| [at[0], height]);
            if let Some(at) = self.choose(&candidates, label) {
                self.write(canvas, at, label);
            }
        }
    }

    fn write(&mut self, canvas: &mut Canvas, at: Px, label: &str) {
        let style = Type {
            halo: true,
            ..Type::plain(LABEL_SIZE, Paint::INK, Anchor::Middle)
        };
        canvas.text([at[0], at[1] + 0.36 * LABEL_SIZE], style, label);
        self.take(label_box(at, label));
    }
}

/// Points on the line between two pixels, close enough to each other to meet every label it passes.
fn along(from: Px, to: Px) -> impl Iterator<Item = Px> {
    let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / 3.0)
        .ceil()
        .max(1.0);
    (0..=steps as u32).map(move |i| {
        let part = f64::from(i) / steps;
        [
            from[0] + part * (to[0] - from[0]),
            from[1] + part * (to[1] - from[1]),
        ]
    })
}

/// The box of a label about its middle.
fn label_box([x, y]: Px, label: &str) -> Rect {
    let (width, height) = (text::width(label, LABEL_SIZE), LABEL_SIZE + 2.0);
    Rect {
        x: x - 0.5 * width,
        y: y - 0.5 * height,
        width,
        height,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_keep_off_the_paths() {
        let mut canvas = Canvas::default();
        let area = Rect {
            x: 0.0,
            y: 0.0,
            width: 300.0,
            height: 200.0,
        };
        let path = vec![[150.0, 100.0], [290.0, 100.0]];
        let mut places = Places::new(area, &[path]);
        places.label_beside(&mut canvas, [150.0, 100.0], [7.0; 2], "start");
        assert!(
            places.taken[0].right() < 150.0,
            "left of the start: {:?}",
            places.taken
        );
    }

    #[test]
    fn labels_do_not_overlap() {
        let mut canvas = Canvas::default();
        let area = Rect {
            x: 0.0,
            y: 0.0,
            width: 300.0,
            height: 200.0,
        };
        let mut places = Places::new(area, &[]);
        for _ in 0..20 {
            places.label_beside(&mut canvas, [150.0, 100.0], [7.0; 2], "start");
        }
        assert!(places.taken.len() > 2);
        for (i, one) in places.taken.iter().enumerate() {
            assert!(places.taken[..i].iter().all(|other| !one.overlaps(other)));
        }
    }
}
