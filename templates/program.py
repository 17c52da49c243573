{% for line in comment -%}
# {{ line }}
{% endfor -%}

import numpy as np

# Values are arrays of height x width x components, in double precision; what has one component
# stands for as many as are wanted.
{%- for helper in helpers %}


{{ helper }}
{%- endfor %}
{%- if !constants.is_empty() %}


# The filter's constants.
{%- for (name, value) in constants %}
{{ name }} = {{ value }}
{%- endfor %}
{%- endif %}
{%- for stage in stages %}


{{ stage }}
{%- endfor %}


def {{ name }}({{ arguments|join(", ") }}, exposure):
    """Filters an image. Returns height x width x 3 numbers, R, G and B of every pixel.

    Arguments are arrays of height x width x components, or of height x width where there is one;
    {{ numbers }}. The lines on top say in which units.
    """
    {%- for argument in arguments %}
    {{ argument }} = image({{ argument }})
    {%- endfor %}
    size = color.shape[:2]
{%- if is_coarse %}
    coarse = ((size[0] + 1) // 2, (size[1] + 1) // 2)
{%- endif %}
{%- for line in run %}
    {{ line }}
{%- endfor %}
    return {{ result }} * exposure
