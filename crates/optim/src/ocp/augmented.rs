//! The pieces of bounds and penalties in the augmented Lagrangian.
//!
//! Each is a convex function with a continuous slope, quadratic in pieces: the Moreau envelope of
//! the bound or of the penalty, shifted by the multiplier known so far (`prior`).

/// Which piece a value lies on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Piece {
    /// Between the bounds, or a constraint that holds.
    #[default]
    Off,
    /// At the lower bound.
    Lower,
    /// At the upper bound.
    Upper,
    /// A constraint at its kink.
    Kink,
    /// A constraint that is violated.
    Violated,
}

/// Slope and curvature of a piece.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Response {
    /// Which it is.
    pub piece: Piece,
    /// The multiplier: what the piece pushes with.
    pub multiplier: f64,
    /// How the push grows per unit; zero where the piece is off.
    pub curvature: f64,
}

impl Response {
    /// Whether both are the same quadratic.
    #[inline(always)]
    pub fn is_alike(&self, other: &Self) -> bool {
        self.piece == other.piece && self.curvature == other.curvature
    }
}

/// The softened constraint `value >= 0`; it pushes `value` up with `multiplier >= 0`.
///
/// Off: nothing. At the kink: `prior - stiffness value`, between 0 and `linear`. Violated: the
/// push `linear + 2 quadratic s` of a violation `s` that gives way to the stiffness.
#[inline(always)]
pub(super) fn soft(
    linear: f64,
    quadratic: f64,
    stiffness: f64,
    prior: f64,
    value: f64,
) -> Response {
    let push = prior - stiffness * value;
    soft_piece(push, linear, quadratic, stiffness, push)
}

/// The piece on which the multiplier `prior` lies, at a value that need not lie on it.
pub(super) fn soft_of(
    linear: f64,
    quadratic: f64,
    stiffness: f64,
    prior: f64,
    value: f64,
) -> Response {
    soft_piece(
        prior,
        linear,
        quadratic,
        stiffness,
        prior - stiffness * value,
    )
}

/// The piece on which the multiplier `on` lies, with `push` where the stiffness alone pushes.
#[inline(always)]
fn soft_piece(on: f64, linear: f64, quadratic: f64, stiffness: f64, push: f64) -> Response {
    if on <= 0.0 {
        Response::default()
    } else if on < linear {
        at(Piece::Kink, stiffness, push)
    } else {
        let share = 2.0 * quadratic / (stiffness + 2.0 * quadratic);
        at(
            Piece::Violated,
            stiffness * share,
            linear + share * (push - linear),
        )
    }
}

/// The bounds of an input; positive multipliers push it down from the upper bound.
#[inline(always)]
pub(super) fn bound(lower: f64, upper: f64, stiffness: f64, prior: f64, input: f64) -> Response {
    let over = prior + stiffness * (input - upper);
    let under = prior + stiffness * (input - lower);
    if over > 0.0 {
        at(Piece::Upper, stiffness, over)
    } else if under < 0.0 {
        at(Piece::Lower, stiffness, under)
    } else {
        Response::default()
    }
}

/// The piece on which the multiplier `prior` lies, at input zero.
pub(super) fn bound_of(lower: f64, upper: f64, stiffness: f64, prior: f64) -> Response {
    if prior > 0.0 && upper.is_finite() {
        at(Piece::Upper, stiffness, prior - stiffness * upper)
    } else if prior < 0.0 && lower.is_finite() {
        at(Piece::Lower, stiffness, prior - stiffness * lower)
    } else {
        Response::default()
    }
}

#[inline(always)]
fn at(piece: Piece, curvature: f64, multiplier: f64) -> Response {
    Response {
        piece,
        multiplier,
        curvature,
    }
}
