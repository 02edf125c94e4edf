//! One page that holds a whole report: text, tables and figures, with nothing to load beside it.

use std::fmt::Write;

use crate::plot::{dark_rules, escape};

/// How something went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Neither good nor bad.
    Neutral,
    /// As it should be.
    Good,
    /// Worth a look.
    Warning,
    /// Not as it should be.
    Bad,
}

impl Status {
    const ALL: [Status; 4] = [Status::Neutral, Status::Good, Status::Warning, Status::Bad];

    fn class(self) -> &'static str {
        match self {
            Status::Neutral => "neutral",
            Status::Good => "good",
            Status::Warning => "warning",
            Status::Bad => "bad",
        }
    }

    /// A sign for readers who do not see the colour.
    fn sign(self) -> &'static str {
        match self {
            Status::Neutral => "",
            Status::Good => "✓",
            Status::Warning => "!",
            Status::Bad => "✗",
        }
    }

    /// Colour in light and in dark mode.
    fn colours(self) -> [&'static str; 2] {
        match self {
            Status::Neutral => ["#8c959f", "#5f6a76"],
            Status::Good => ["#007a59", "#1fbf92"],
            Status::Warning => ["#9a6700", "#f0b429"],
            Status::Bad => ["#b84300", "#ee7a22"],
        }
    }
}

/// One figure of the summary.
#[derive(Debug, Clone)]
pub struct Fact {
    /// What it is.
    pub label: String,
    /// How much it is, with its unit.
    pub value: String,
    /// How good that is.
    pub status: Status,
}

/// Room that a figure takes on the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Span {
    /// The whole width.
    Full,
    /// Half the width, where the window is wide enough.
    Half,
}

/// A figure on the page.
#[derive(Debug, Clone)]
pub struct PageFigure {
    /// The figure, as an SVG document of [`crate::plot`].
    pub svg: String,
    /// What stands below it; may be empty.
    pub caption: String,
    /// Room that it takes.
    pub span: Span,
}

/// A row of a table.
#[derive(Debug, Clone)]
pub struct Row {
    /// Its cells.
    pub cells: Vec<String>,
    /// Rows that are not neutral are highlighted.
    pub status: Status,
}

/// A table.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// What stands above it; may be empty.
    pub title: String,
    /// Names of the columns, with units.
    pub header: Vec<String>,
    /// Its rows. Columns of numbers are set flush right.
    pub rows: Vec<Row>,
    /// What stands below it; may be empty.
    pub caption: String,
}

/// A report on one page.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Title.
    pub title: String,
    /// What stands below the title; may be empty.
    pub subtitle: String,
    /// The figures that matter most.
    pub summary: Vec<Fact>,
    /// Figures, in reading order.
    pub figures: Vec<PageFigure>,
    /// Tables, below the figures.
    pub tables: Vec<Table>,
    /// Remarks, below the tables.
    pub notes: Vec<String>,
    /// Last line; may be empty.
    pub footer: String,
}

impl Page {
    /// The page as an HTML document that needs no other file, no script and no network.
    pub fn to_html(&self) -> String {
        let title = escape(&self.title);
        let mut html = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" \
             content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n\
             <title>{title}</title>\n<style>\n{}</style>\n</head>\n<body>\n<main>\n",
            style()
        );
        let _ = write!(html, "<header>\n<h1>{title}</h1>\n");
        paragraph(&mut html, "subtitle", &self.subtitle);
        html.push_str("</header>\n");
        self.write_summary(&mut html);
        self.write_figures(&mut html);
        self.tables.iter().for_each(|table| table.write(&mut html));
        self.write_notes(&mut html);
        if !self.footer.is_empty() {
            let _ = writeln!(html, "<footer>{}</footer>", escape(&self.footer));
        }
        html.push_str("</main>\n</body>\n</html>\n");
        html
    }

    fn write_summary(&self, html: &mut String) {
        if self.summary.is_empty() {
            return;
        }
        html.push_str("<dl class=\"summary\">\n");
        for Fact {
            label,
            value,
            status,
        } in &self.summary
        {
            let (class, label, value) = (status.class(), escape(label), escape(value));
            let sign = match status.sign() {
                "" => String::new(),
                sign => format!("<span class=\"sign\">{sign}</span> "),
            };
            let _ = writeln!(
                html,
                "<div class=\"fact {class}\"><dt>{label}</dt><dd>{sign}{value}</dd></div>"
            );
        }
        html.push_str("</dl>\n");
    }

    fn write_figures(&self, html: &mut String) {
        if self.figures.is_empty() {
            return;
        }
        html.push_str("<section class=\"figures\">\n");
        for PageFigure { svg, caption, span } in &self.figures {
            let class = if *span == Span::Full { "full" } else { "half" };
            let _ = writeln!(html, "<figure class=\"{class}\">\n{}", svg.trim_end());
            if !caption.is_empty() {
                let _ = writeln!(html, "<figcaption>{}</figcaption>", escape(caption));
            }
            html.push_str("</figure>\n");
        }
        html.push_str("</section>\n");
    }

    fn write_notes(&self, html: &mut String) {
        if self.notes.is_empty() {
            return;
        }
        html.push_str("<section class=\"notes\">\n<h2>Notes</h2>\n<ul>\n");
        for note in &self.notes {
            let _ = writeln!(html, "<li>{}</li>", escape(note));
        }
        html.push_str("</ul>\n</section>\n");
    }
}

impl Table {
    fn write(&self, html: &mut String) {
        html.push_str("<section class=\"table\">\n");
        if !self.title.is_empty() {
            let _ = writeln!(html, "<h2>{}</h2>", escape(&self.title));
        }
        html.push_str("<div class=\"scroll\"><table>\n<thead>");
        self.write_cells(html, "th", &self.header);
        html.push_str("</thead>\n<tbody>\n");
        for row in &self.rows {
            let _ = write!(html, "<tr class=\"{}\">", row.status.class());
            self.write_row(html, "td", &row.cells);
        }
        html.push_str("</tbody>\n</table></div>\n");
        paragraph(html, "caption", &self.caption);
        html.push_str("</section>\n");
    }

    fn write_cells(&self, html: &mut String, tag: &str, cells: &[String]) {
        html.push_str("<tr>");
        self.write_row(html, tag, cells);
    }

    fn write_row(&self, html: &mut String, tag: &str, cells: &[String]) {
        for (column, cell) in cells.iter().enumerate() {
            let class = if self.is_numeric(column) {
                " class=\"number\""
            } else {
                ""
            };
            let _ = write!(html, "<{tag}{class}>{}</{tag}>", escape(cell));
        }
        html.push_str("</tr>\n");
    }

    /// The table as lines of text, the header first.
    pub fn to_lines(&self) -> Vec<String> {
        let rows = || {
            [&self.header]
                .into_iter()
                .chain(self.rows.iter().map(|row| &row.cells))
        };
        let width = |column: usize| {
            let cells = rows().filter_map(|cells| cells.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let padded = |(column, cell): (usize, &String)| {
            let width = width(column);
            if self.is_numeric(column) {
                format!("{cell:>width$}")
            } else {
                format!("{cell:<width$}")
            }
        };
        let line = |cells: &Vec<String>| {
            let cells: Vec<String> = cells.iter().enumerate().map(padded).collect();
            cells.join("   ").trim_end().to_owned()
        };
        rows().map(line).collect()
    }

    /// Whether the column holds numbers only, and places where one is missing.
    fn is_numeric(&self, column: usize) -> bool {
        let cells = || self.rows.iter().filter_map(|row| row.cells.get(column));
        cells().any(|cell| is_number(cell))
            && cells().all(|cell| is_number(cell) || is_missing(cell))
    }
}

fn is_number(cell: &str) -> bool {
    let digits = cell.trim_start_matches(['-', '+', '\u{2212}', '±', '<', '>', ' ']);
    digits.starts_with(|c: char| c.is_ascii_digit())
}

fn is_missing(cell: &str) -> bool {
    matches!(cell, "" | "-" | "–" | "—" | "n/a" | "NaN")
}

fn paragraph(html: &mut String, class: &str, text: &str) {
    if !text.is_empty() {
        let _ = writeln!(html, "<p class=\"{class}\">{}</p>", escape(text));
    }
}

/// Style of the page: light, dark if the reader's system is, and light on printed paper.
fn style() -> String {
    let statuses = |mode: usize| {
        Status::ALL.iter().fold(String::new(), |mut css, status| {
            let _ = write!(
                css,
                ".{}{{--status:{}}}",
                status.class(),
                status.colours()[mode]
            );
            css
        })
    };
    format!(
        "{STYLE}{}\n@media screen and (prefers-color-scheme:dark){{\n{DARK}{}\n{}\n}}\n",
        statuses(0),
        statuses(1),
        dark_rules()
    )
}

const STYLE: &str = "\
:root{--paper:#fff;--page:#f4f5f7;--ink:#1f2328;--muted:#59636e;--rule:#dde1e6;color-scheme:light}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--ink);font:15px/1.5 system-ui,-apple-system,'Segoe UI',\
Roboto,'DejaVu Sans',sans-serif}
main{max-width:1240px;margin:0 auto;padding:32px 24px 24px}
h1{margin:0;font-size:28px;line-height:1.2;letter-spacing:-.01em}
h2{margin:0 0 10px;font-size:17px}
.subtitle{margin:6px 0 0;color:var(--muted)}
.summary{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px;margin:24px 0}
.fact{background:var(--paper);border:1px solid var(--rule);border-left:4px solid var(--status);\
border-radius:6px;padding:10px 14px}
dt{color:var(--muted);font-size:12.5px}
dd{margin:2px 0 0;font-size:19px;font-weight:600;font-variant-numeric:tabular-nums}
.sign{color:var(--status)}
.figures{display:grid;grid-template-columns:1fr 1fr;gap:16px;margin:24px 0}
figure,.table,.notes{background:var(--paper);border:1px solid var(--rule);border-radius:6px;margin:0}
figure{padding:14px;min-width:0}
.full{grid-column:1/-1}
svg.plot{display:block;width:100%;height:auto}
figcaption,.caption{margin:8px 4px 0;color:var(--muted);font-size:13px}
.table,.notes{padding:16px 18px;margin:16px 0}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:13.5px;font-variant-numeric:tabular-nums}
th,td{padding:5px 12px;text-align:left;white-space:nowrap;border-bottom:1px solid var(--rule)}
th{color:var(--muted);font-weight:600;border-bottom:2px solid var(--rule)}
.number{text-align:right}
tbody tr:last-child td{border-bottom:0}
tr.good,tr.warning,tr.bad{background:color-mix(in srgb,var(--status) 13%,transparent)}
tr.good td:first-child,tr.warning td:first-child,tr.bad td:first-child{box-shadow:inset 4px 0 var(--status)}
ul{margin:0;padding-left:20px}
footer{margin-top:24px;color:var(--muted);font-size:12.5px}
@media (max-width:820px){.figures{grid-template-columns:1fr}main{padding:20px 12px}}
@media print{body{background:#fff}main{max-width:none;padding:0}figure,.table,.notes,.fact{break-inside:avoid}}
";

const DARK: &str = "\
:root{--paper:#161a1f;--page:#0d1014;--ink:#e8ebef;--muted:#9aa5b1;--rule:#2c333b;color-scheme:dark}
";

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> Page {
        let row = |cells: [&str; 3], status| Row {
            cells: cells.map(str::to_string).to_vec(),
            status,
        };
        Page {
            title: "Flight <1> & more".to_string(),
            subtitle: "seed 7".to_string(),
            summary: vec![Fact {
                label: "outcome".to_string(),
                value: "reached".to_string(),
                status: Status::Good,
            }],
            tables: vec![Table {
                header: ["name", "error (m)", "limit (m)"]
                    .map(str::to_string)
                    .to_vec(),
                rows: vec![
                    row(["1st", "−0.25", "n/a"], Status::Bad),
                    row(["second", "3", "4"], Status::Neutral),
                ],
                ..Table::default()
            }],
            footer: "made by hand".to_string(),
            ..Page::default()
        }
    }

    #[test]
    fn text_is_escaped() {
        let html = page().to_html();
        assert!(html.contains("<h1>Flight &lt;1&gt; &amp; more</h1>"));
        assert!(!html.contains("<1>"));
    }

    #[test]
    fn nothing_is_loaded_from_elsewhere() {
        let html = page().to_html();
        for word in [
            "http:", "https:", "url(", "src=", "href", "<script", "@import",
        ] {
            assert!(!html.contains(word), "{word}");
        }
    }

    #[test]
    fn columns_of_numbers_are_flush_right() {
        let table = &page().tables[0];
        assert_eq!(
            [0, 1, 2, 9].map(|column| table.is_numeric(column)),
            [false, true, true, false]
        );
    }

    #[test]
    fn lines_of_text_have_their_numbers_flush_right() {
        assert_eq!(
            page().tables[0].to_lines(),
            [
                "name     error (m)   limit (m)",
                "1st          −0.25         n/a",
                "second           3           4",
            ]
        );
    }

    #[test]
    fn the_worst_row_is_highlighted() {
        assert!(page().to_html().contains("<tr class=\"bad\"><td>1st</td>"));
    }

    #[test]
    fn elements_are_closed_in_order() {
        let html = page().to_html();
        let mut open: Vec<&str> = Vec::new();
        for tag in html.split('<').skip(1) {
            let name = tag.split(['>', ' ', '\n']).next().unwrap();
            match name.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name)),
                None if matches!(name, "!DOCTYPE" | "meta") => {}
                None => open.push(name),
            }
        }
        assert!(open.is_empty(), "{open:?}");
    }
}
