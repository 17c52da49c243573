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
/* Sums over a window. */
struct {{ name }}_sums {
    float color[3];  /* of colours times weights */
    float total;     /* of weights */
    {%- if signed %}
    float magnitude; /* of weights without their signs */
    {%- endif %}
};

/* Adds the taps of pixel (x, y) that lie dy rows below it, `count` of them: the
   first dx columns to its right, each `step` columns from the one before. */
static void {{ name }}_run(const struct {{ name }}_images *images, int x, int y, int dx, int dy, int count,
    int step, struct {{ name }}_sums *sums)
{
    struct {{ name }}_sums run = {0};
    {%- if let Some(at) = at_i %}
    {%- if at.contains("here") %}
    const size_t here = (size_t)y * (size_t)images->width + (size_t)x;
    {%- endif %}
    const struct {{ name }}_features i = {{ name }}_read({{ at }});
    {%- endif %}
    if (y + dy < 0 || y + dy >= images->height)
        return;
    for (; count > 0; --count, dx += step) {
        if (x + dx < 0 || x + dx >= images->width)
            continue;
        const size_t there = (size_t)(y + dy) * (size_t)images->width + (size_t)(x + dx);
        {%- if let Some(at) = at_j %}
        const struct {{ name }}_features j = {{ name }}_read({{ at }});
        {%- endif %}
        const float w = {{ name }}_weight({{ arguments }});
        for (int c = 0; c < 3; ++c)
            run.color[c] = fmaf(w, images->noisy[c][there], run.color[c]);
        run.total += w;
        {%- if signed %}
        run.magnitude += fabsf(w);
        {%- endif %}
    }
    for (int c = 0; c < 3; ++c)
        sums->color[c] += run.color[c];
    sums->total += run.total;
    {%- if signed %}
    sums->magnitude += run.magnitude;
    {%- endif %}
}

/* Filters pixel (x, y): the mean of its window by the weights, summed run by run.
   The order decides the last bits only: the rows above from the top, each from
   left to right; what lies right of the pixel, from the far end; the pixel; the
   rows below, each from right to left; what lies left of it. Returns 1; or 0 where
   the weights sum to nothing that can be trusted, and the noisy colour is kept. */
static int {{ name }}_pixel(const struct {{ name }}_images *images, int x, int y, float rgb[3])
{
    const int radius = {{ radius }}, step = {{ step }}, reach = radius * step;
    const size_t here = (size_t)y * (size_t)images->width + (size_t)x;
    struct {{ name }}_sums sums = {0};
    for (int dy = -reach; dy < 0; dy += step)
        {{ name }}_run(images, x, y, -reach, dy, 2 * radius + 1, step, &sums);
    {{ name }}_run(images, x, y, reach, 0, radius, -step, &sums);
    {{ name }}_run(images, x, y, 0, 0, 1, step, &sums);
    for (int dy = step; dy <= reach; dy += step)
        {{ name }}_run(images, x, y, reach, dy, 2 * radius + 1, -step, &sums);
    {{ name }}_run(images, x, y, -reach, 0, radius, step, &sums);
    if (fabsf(sums.total) >= {{ least }}
        {%- if signed %} && fabsf(sums.total) >= {{ share }} * sums.magnitude{% endif %}) {
        for (int c = 0; c < 3; ++c)
            rgb[c] = sums.color[c] / sums.total;
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
struct KernelTemplate<'a> {
    name: &'a str,
    radius: u32,
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
        let window = self.subject.plan.support();
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
        let kernel = KernelTemplate {
            name: self.name,
            radius: window.radius,
            step: window.dilation,
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
