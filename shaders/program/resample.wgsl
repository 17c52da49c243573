{# Planes on the other grid. #}
{% extends "program/kernel.wgsl" %}
{% block pixel %}
{%- if is_half %}
    // The mean of four pixels.
    let upper_left = place_of(2 * at, params.size);
    let upper_right = place_of(2 * at + vec2<i32>(1, 0), params.size);
    let lower_left = place_of(2 * at + vec2<i32>(0, 1), params.size);
    let lower_right = place_of(2 * at + vec2<i32>(1, 1), params.size);
{%- else %}
    // What lies between the nearest pixels of half the resolution, a quarter of the way.
    let nearest = at / 2;
    let other = nearest + 2 * (at - 2 * nearest) - vec2<i32>(1);
    let here = place_of(nearest, params.half_size);
    let beside = place_of(vec2<i32>(other.x, nearest.y), params.half_size);
    let here_far = place_of(vec2<i32>(nearest.x, other.y), params.half_size);
    let beside_far = place_of(other, params.half_size);
{%- endif %}
{%- for plane in planes %}
{%- if let Some(component) = plane.pixel %}
    // The middle of two pixels, also where there is one.
    planes[{{ plane.to }} + place] = f32(params.corner.{{ component }} + 2 * at.{{ component }}) + 0.5f;
{%- else if is_half %}
    let upper_{{ loop.index0 }} = {{ plane.from }} + upper_left] + {{ plane.from }} + upper_right];
    let lower_{{ loop.index0 }} = {{ plane.from }} + lower_left] + {{ plane.from }} + lower_right];
    planes[{{ plane.to }} + place] = 0.25f * (upper_{{ loop.index0 }} + lower_{{ loop.index0 }});
{%- else %}
    let here_{{ loop.index0 }} = {{ plane.from }} + here];
    let beside_{{ loop.index0 }} = {{ plane.from }} + beside];
    let near_{{ loop.index0 }} = here_{{ loop.index0 }} + 0.25f * ({{ plane.from }} + here_far] - here_{{ loop.index0 }});
    let far_{{ loop.index0 }} = beside_{{ loop.index0 }} + 0.25f * ({{ plane.from }} + beside_far] - beside_{{ loop.index0 }});
    planes[{{ plane.to }} + place] = near_{{ loop.index0 }} + 0.25f * (far_{{ loop.index0 }} - near_{{ loop.index0 }});
{%- endif %}
{%- endfor %}
{%- endblock %}
