//! Widths of text, so that layout does not need a font.

/// Advance widths of DejaVu Sans for the characters from space to tilde, in thousandths of an em.
const ADVANCE: [u16; 95] = [
    317, 400, 459, 837, 636, 950, 779, 274, 390, 390, 500, 837, 317, 360, 317, 336, 636, 636, 636,
    636, 636, 636, 636, 636, 636, 636, 336, 336, 837, 837, 837, 530, 1000, 684, 686, 698, 770, 631,
    575, 774, 751, 294, 294, 655, 557, 862, 748, 787, 603, 787, 694, 634, 610, 731, 684, 988, 685,
    610, 685, 390, 336, 390, 837, 500, 500, 612, 634, 549, 634, 615, 352, 634, 633, 277, 277, 579,
    277, 974, 633, 611, 634, 634, 411, 520, 392, 633, 591, 817, 591, 591, 524, 636, 336, 636, 837,
];

/// A width between those of letters, for characters outside the table.
const OTHER_ADVANCE: u16 = 640;

/// Bold is on average this much wider than regular.
const BOLD_FACTOR: f64 = 1.11;

/// Width in pixels of `text` set in DejaVu Sans at `size` pixels.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let thousandths: u32 = text.chars().map(|c| u32::from(advance(c))).sum();
    f64::from(thousandths) * size / 1000.0
}

/// Width in pixels of `text` set in bold.
pub(super) fn bold_width(text: &str, size: f64) -> f64 {
    BOLD_FACTOR * width(text, size)
}

fn advance(c: char) -> u16 {
    (c as usize)
        .checked_sub(' ' as usize)
        .and_then(|index| ADVANCE.get(index))
        .copied()
        .unwrap_or(OTHER_ADVANCE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn width_is_the_sum_of_the_advances() {
        assert_eq!(width("A1 ", 1000.0), 684.0 + 636.0 + 317.0);
    }

    #[test]
    fn characters_outside_the_table_have_a_width_too() {
        assert_eq!(width("σ", 100.0), 64.0);
    }
}
