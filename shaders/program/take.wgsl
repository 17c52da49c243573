{# The filtered colours of the pixels that are wanted. -#}
@compute @workgroup_size({{ workgroup[0] }}, {{ workgroup[1] }})
fn {{ name }}(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = vec2<i32>(id.xy);
    if (any(at >= params.wanted)) {
        return;
    }
    let place = place_of(params.origin + at, params.size);
    let pixel = at.y * params.wanted.x + at.x;
{%- if pictures.len() == 1 %}
{%- let [red, green, blue] = pictures[0] %}
    let color = vec3<f32>({{ red }}, {{ green }}, {{ blue }});
    result[pixel] = vec4<f32>(color * params.exposure, 0f);
{%- else %}
{%- for [red, green, blue] in pictures %}
    let color_{{ loop.index0 }} = vec3<f32>({{ red }}, {{ green }}, {{ blue }});
    result[{{ pictures.len() }} * pixel + {{ loop.index0 }}] = vec4<f32>(color_{{ loop.index0 }} * params.exposure, 0f);
{%- endfor %}
{%- endif %}
}
