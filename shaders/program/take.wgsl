{# The filtered colours of the pixels that are wanted. -#}
@compute @workgroup_size({{ workgroup[0] }}, {{ workgroup[1] }})
fn {{ name }}(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = vec2<i32>(id.xy);
    if (any(at >= params.wanted)) {
        return;
    }
    let place = place_of(params.origin + at, params.size);
    let color = vec3<f32>({{ red }}, {{ green }}, {{ blue }});
    result[at.y * params.wanted.x + at.x] = vec4<f32>(color * params.exposure, 0f);
}
