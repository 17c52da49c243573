{# A value at every pixel. -#}
@compute @workgroup_size({{ workgroup[0] }}, {{ workgroup[1] }})
fn {{ name }}(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = vec2<i32>(id.xy);
    let size = params.{{ size }};
    if (any(at >= size)) {
        return;
    }
    let place = u32(at.y * size.x + at.x);
{%- for read in reads %}
    let r{{ loop.index0 }} = {{ read }};
{%- endfor %}
    {%- if !lines.is_empty() %}
    {{ lines|indent(4) }}
    {%- endif %}
{%- for (to, value) in writes %}
    planes[{{ to }} + place] = {{ value }};
{%- endfor %}
}
