{# A value at every pixel. #}
{% extends "c/kernel.c" %}
{% block pixel %}
{%- for line in reads %}
            {{ line }}
{%- endfor %}
{%- for line in lines %}
            {{ line }}
{%- endfor %}
{%- for (to, value) in writes %}
            {{ to }}[i] = {{ value }} + 0.0f;
{%- endfor %}
{%- endblock %}
