{# A kernel over all pixels of a grid. -#}
@compute @workgroup_size({{ workgroup[0] }}, {{ workgroup[1] }})
fn {{ name }}(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = vec2<i32>(id.xy);
    let size = params.{{ size }};
    if (any(at >= size)) {
        return;
    }
    let place = u32(at.y * size.x + at.x);
{%- block pixel %}{% endblock %}
}
