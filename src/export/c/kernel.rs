//! Equation 1 around the weight function: at one pixel, and over an image.

use askama::Template;

use super::weight::constant;
use super::{Source, list};
use crate::backend::{TRUSTED_SHARE, TRUSTED_SUM};

#[derive(Template)]
#[template(
    ext = "txt",
    escape = "none",
    source = r#"
{%- if !reads.is_empty() %}
static struct {{ name }}_features {{ name }}_read({{ parameters }})
{
    struct {{ name }}_features features;
    {%- for (field, value) in reads %}
    features.{{ field }} = {{ value }};
    {%- endfor %}
    return features;
}
{% endif %}
/* Filters pixel (x, y): the mean of its window by the weights, summed row by
   row. Returns 1; or 0 where the weights sum to nothing that can be trusted, and
   the noisy colour is kept. */
static int {{ name }}_pixel(const struct {{ name }}_images *images, int x, int y, float rgb[3])
{
    const int reach = {{ reach }}, step = {{ step }};
    const size_t here = (size_t)y * (size_t)images->width + (size_t)x;
    {%- if let Some(at) = at_i %}
    const struct {{ name }}_features i = {{ name }}_read({{ at }});
    {%- endif %}
    float sum[3] = {0.0f, 0.0f, 0.0f}; /* of colours times weights */
    float total = 0.0f;                /* of weights */
    {%- if signed %}
    float magnitude = 0.0f;            /* of weights without their signs */
    {%- endif %}
    for (int dy = -reach; dy <= reach; dy += step) {
        float row[3] = {0.0f, 0.0f, 0.0f};
        float row_total = 0.0f;
        {%- if signed %}
        float row_magnitude = 0.0f;
        {%- endif %}
        if (y + dy < 0 || y + dy >= images->height)
            continue;
        for (int dx = -reach; dx <= reach; dx += step) {
            if (x + dx < 0 || x + dx >= images->width)
                continue;
            const size_t there = (size_t)(y + dy) * (size_t)images->width + (size_t)(x + dx);
            {%- if let Some(at) = at_j %}
            const struct {{ name }}_features j = {{ name }}_read({{ at }});
            {%- endif %}
            const float w = {{ name }}_weight({{ arguments }});
            for (int c = 0; c < 3; ++c)
                row[c] = fmaf(w, images->noisy[c][there], row[c]);
            row_total += w;
            {%- if signed %}
            row_magnitude += fabsf(w);
            {%- endif %}
        }
        for (int c = 0; c < 3; ++c)
            sum[c] += row[c];
        total += row_total;
        {%- if signed %}
        magnitude += row_magnitude;
        {%- endif %}
    }
    if (fabsf(total) >= {{ least }}
        {%- if signed %} && fabsf(total) >= {{ share }} * magnitude{% endif %}) {
        for (int c = 0; c < 3; ++c)
            rgb[c] = sum[c] / total;
        if (isfinite(rgb[0]) && isfinite(rgb[1]) && isfinite(rgb[2]))
            return 1;
    }
    for (int c = 0; c < 3; ++c)
        rgb[c] = images->noisy[c][here];
    return 0;
}

/* Filters the images into R, G and B of their size, which must not be among
   them. Returns how many pixels kept their noisy colour. Pixels do not depend on
   each other: rows may be given to threads. */
size_t {{ name }}_filter(const struct {{ name }}_images *images, float *const out[3])
{
    size_t kept = 0;
    for (int y = 0; y < images->height; ++y) {
        for (int x = 0; x < images->width; ++x) {
            const size_t here = (size_t)y * (size_t)images->width + (size_t)x;
            float rgb[3];
            kept += {{ name }}_pixel(images, x, y, rgb) ? 0 : 1;
            for (int c = 0; c < 3; ++c)
                out[c][here] = rgb[c];
        }
    }
    return kept;
}
"#
)]
struct Kernel<'a> {
    name: &'a str,
    reach: u32,
    step: u32,
    /// Whether weights may cancel.
    signed: bool,
    least: String,
    share: String,
    /// What a pixel's features are read from, field by field.
    reads: Vec<(String, String)>,
    /// The parameters that these values are made of, and the arguments for them
    /// at either pixel, if the weight looks at it.
    parameters: String,
    at_i: Option<String>,
    at_j: Option<String>,
    /// Of the weight function.
    arguments: String,
}

impl Source<'_> {
    /// Equation 1 at one pixel, and over the image.
    pub(super) fn kernel(&self) -> String {
        let window = self.subject.plan.window();
        let images = format!("const struct {}_images *images, size_t at", self.name);
        let given = [
            (self.images().next().is_some(), [&*images, "images, here", "images, there"]),
            (self.places().next().is_some(), ["int x, int y", "x, y", "x + dx, y + dy"]),
        ];
        let [parameters, at_i, at_j] =
            [0, 1, 2].map(|which| list(given.map(|(is_given, texts)| (is_given, texts[which]))));
        let arguments = list([
            (self.reads_i, "&i"),
            (self.reads_j, "&j"),
            (self.reads_dx, "(float)dx"),
            (self.reads_dy, "(float)dy"),
        ]);
        let kernel = Kernel {
            name: self.name,
            reach: window.reach(),
            // Taps no pixel apart are all the same one.
            step: window.dilation.max(1),
            signed: self.subject.plan.signed(),
            least: constant(TRUSTED_SUM),
            share: constant(TRUSTED_SHARE),
            reads: self.reads(),
            parameters,
            at_i: self.reads_i.then_some(at_i),
            at_j: self.reads_j.then_some(at_j),
            arguments,
        };
        kernel.render().expect("nothing fails that writes into a string")
    }

    /// Every field of a pixel's features with the value that it gets.
    fn reads(&self) -> Vec<(String, String)> {
        let mut reads = Vec::new();
        for &term in &self.terms {
            for component in 0..term.components() {
                let field = match term.components() {
                    1 => term.field(),
                    _ => format!("{}[{component}]", term.field()),
                };
                let value = match term.is_image() {
                    true => format!("images->{field}[at]"),
                    false => format!("(float){}", ["x", "y"][component]),
                };
                reads.push((field, value));
            }
        }
        reads
    }
}
