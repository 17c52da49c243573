{# A value at every pixel. #}
{% extends "program/kernel.wgsl" %}
{% block pixel %}
{%- for read in reads %}
    let r{{ loop.index0 }} = {{ read }};
{%- endfor %}
    {%- if !lines.is_empty() %}
    {{ lines|indent(4) }}
    {%- endif %}
{%- for (to, value) in writes %}
    planes[{{ to }} + place] = {{ value }};
{%- endfor %}
{%- endblock %}
