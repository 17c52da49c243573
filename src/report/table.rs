//! Tables of text: for terminals, Markdown pages and browsers.

/// How a table is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Columns apart by two spaces, under a line.
    Plain,
    /// A Markdown table.
    Markdown,
}

/// On which side the cells of a column stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Words.
    Left,
    /// Numbers.
    Right,
}

/// Cells under headings.
#[derive(Clone, Debug)]
pub struct Table {
    columns: Vec<(String, Align)>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = (S, Align)>) -> Self {
        let columns = columns.into_iter().map(|(name, align)| (name.into(), align)).collect();
        Self { columns, rows: Vec::new() }
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it does not have one cell per column.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        let cells: Vec<String> = cells.into_iter().map(Into::into).collect();
        assert_eq!(cells.len(), self.columns.len(), "a row has one cell per column");
        self.rows.push(cells);
    }

    /// Adds a row whose cells are broken between words so that none is wider
    /// than `width`: for terminals, where wide tables cannot be read.
    pub fn wrapped_row<S: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = S>, width: usize) {
        let columns: Vec<Vec<String>> =
            cells.into_iter().map(|cell| wrapped(cell.as_ref(), width)).collect();
        for line in 0..columns.iter().map(Vec::len).max().unwrap_or(0) {
            self.row(columns.iter().map(|lines| lines.get(line).cloned().unwrap_or_default()));
        }
    }

    /// The table as HTML: cells are text, whatever is in them.
    pub fn html(&self) -> String {
        let row = |tag: &str, cells: &mut dyn Iterator<Item = &str>| {
            let cells = cells.zip(&self.columns).map(|(cell, (_, align))| {
                let class = if *align == Align::Right { " class=\"right\"" } else { "" };
                format!("<{tag}{class}>{}</{tag}>", escaped(cell))
            });
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        };
        let head = row("th", &mut self.columns.iter().map(|(name, _)| name.as_str()));
        let rows = self.rows.iter().map(|cells| row("td", &mut cells.iter().map(String::as_str)));
        let rows: String = rows.collect();
        format!("<table>\n<thead>{head}</thead>\n<tbody>\n{rows}</tbody>\n</table>\n")
    }

    /// The table as text, every line ended.
    pub fn render(&self, format: Format) -> String {
        let escaped = |cell: &str| match format {
            Format::Plain => cell.to_owned(),
            Format::Markdown => cell.replace('|', "\\|"),
        };
        let heads: Vec<String> = self.columns.iter().map(|(name, _)| escaped(name)).collect();
        let rows: Vec<Vec<String>> =
            self.rows.iter().map(|row| row.iter().map(|cell| escaped(cell)).collect()).collect();
        let width = |k: usize| {
            let cells = rows.iter().map(|row| &row[k]).chain([&heads[k]]);
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0).max(3)
        };
        let widths: Vec<usize> = (0..heads.len()).map(width).collect();
        let line = |cells: &[String]| {
            let padded = cells.iter().zip(&self.columns).zip(&widths).map(
                |((cell, &(_, align)), &width)| match align {
                    Align::Left => format!("{cell:<width$}"),
                    Align::Right => format!("{cell:>width$}"),
                },
            );
            let padded: Vec<String> = padded.collect();
            match format {
                Format::Plain => padded.join("  ").trim_end().to_owned() + "\n",
                Format::Markdown => format!("| {} |\n", padded.join(" | ")),
            }
        };
        let rule = |&(_, align): &(String, Align), &width: &usize| match (format, align) {
            (Format::Plain, _) => "-".repeat(width),
            (Format::Markdown, Align::Left) => "-".repeat(width),
            (Format::Markdown, Align::Right) => "-".repeat(width - 1) + ":",
        };
        let rules: Vec<String> =
            self.columns.iter().zip(&widths).map(|(c, w)| rule(c, w)).collect();
        let mut text = line(&heads) + &line(&rules);
        rows.iter().for_each(|row| text.push_str(&line(row)));
        text
    }
}

/// A text as HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// A text in lines of at most `width` characters, if its words allow it.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last_mut().expect("never empty");
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= width {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_in_both_formats() {
        let mut table = Table::new([("scene", Align::Left), ("noisy", Align::Right)]);
        table.row(["größe", "0.5"]);
        table.row(["a|b", "0.123"]);
        assert_eq!(
            table.render(Format::Plain),
            "scene  noisy\n-----  -----\ngröße    0.5\na|b    0.123\n"
        );
        assert_eq!(
            table.render(Format::Markdown),
            "| scene | noisy |\n| ----- | ----: |\n| größe |   0.5 |\n| a\\|b  | 0.123 |\n"
        );
    }

    #[test]
    fn cells_of_html_are_text() {
        let mut table = Table::new([("a < b", Align::Left), ("n", Align::Right)]);
        table.row(["<b>&", "1"]);
        assert_eq!(
            table.html(),
            "<table>\n<thead><tr><th>a &lt; b</th><th class=\"right\">n</th></tr>\n</thead>\n\
             <tbody>\n<tr><td>&lt;b&gt;&amp;</td><td class=\"right\">1</td></tr>\n</tbody>\n\
             </table>\n"
        );
    }

    #[test]
    fn wrapped_rows_go_on_below() {
        let mut table = Table::new([("a", Align::Left), ("b", Align::Left)]);
        table.wrapped_row(["x", "one two three"], 7);
        assert_eq!(table.render(Format::Plain), "a    b\n---  -------\nx    one two\n     three\n");
    }
}
