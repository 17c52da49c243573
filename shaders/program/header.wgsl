{# What the kernels of a program share. Rendered by src/backend/shader/program.rs. -#}
struct Params {
    // Columns and rows of the region that features and planes hold: of the image's pixels,
    size: vec2<i32>,
    // and of half the resolution.
    half_size: vec2<i32>,
    // Where the region's first pixel stands in the image: even.
    corner: vec2<i32>,
    // Where in the region the pixels begin that are wanted,
    origin: vec2<i32>,
    // and how many columns and rows of them there are.
    wanted: vec2<i32>,
    // By what results are multiplied.
    exposure: f32,
    // Always 0, which the compiler must not know.
    zero: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// Features, one plane after the other, each row by row:
{%- for line in features_doc %}
// {{ line }}
{%- endfor %}
@group(0) @binding(1) var<storage, read> features: array<f32>;
// What depends on offsets alone: per tap its columns and rows, then values.
@group(0) @binding(2) var<storage, read> taps: array<f32>;
// What kernels leave to later ones: {{ full }} planes of the region, then {{ half }} of half the resolution.
@group(0) @binding(3) var<storage, read_write> planes: array<f32>;
// How many pixels kept what was to be averaged, by stage.
@group(0) @binding(4) var<storage, read_write> kept: array<atomic<u32>>;
// The filtered colours, pixel by pixel.
@group(0) @binding(5) var<storage, read_write> result: array<vec4<f32>>;

// Where a plane of the region begins,
fn full(plane: u32) -> u32 {
    return plane * u32(params.size.x * params.size.y);
}

// and one of half the resolution.
fn half(plane: u32) -> u32 {
    return full({{ full }}u) + plane * u32(params.half_size.x * params.half_size.y);
}

// Where a pixel stands in a plane; beside the region its edge is repeated.
fn place_of(at: vec2<i32>, size: vec2<i32>) -> u32 {
    let inside = clamp(at, vec2<i32>(0), size - vec2<i32>(1));
    return u32(inside.y * size.x + inside.x);
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}
