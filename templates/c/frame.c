/* What kernels share: the inputs, the sizes of the image and of half the resolution, and the
   planes that kernels leave to later ones. A plane's place is used again as soon as nobody
   reads what stands there. */
struct {{ name }}_run {
    const struct {{ name }}_inputs *in;
    int size[2];
    int half_size[2];
    float *planes;
};

/* Rows do not depend on each other: with -fopenmp they are shared out to threads. */
#ifdef _OPENMP
#define {{ upper }}_ROWS _Pragma("omp parallel for")
#else
#define {{ upper }}_ROWS
#endif

#define {{ upper }}_FULL_PLANES {{ full }}
#define {{ upper }}_HALF_PLANES {{ half }}
{%- if full > 0 || half > 0 %}

/* A plane of the image's size. */
static float *{{ name }}_full(const struct {{ name }}_run *run, size_t plane)
{
    return run->planes + plane * (size_t)run->size[0] * (size_t)run->size[1];
}
{%- endif %}
{%- if half > 0 %}

/* A plane of half the resolution; these stand behind the others. */
static float *{{ name }}_half(const struct {{ name }}_run *run, size_t plane)
{
    return {{ name }}_full(run, {{ upper }}_FULL_PLANES) + plane * (size_t)run->half_size[0] * (size_t)run->half_size[1];
}
{%- endif %}
{%- if places %}

/* Where a pixel stands in a plane; beside the image its edge is repeated. */
static size_t {{ name }}_at(const int size[2], int x, int y)
{
    x = x < 0 ? 0 : x >= size[0] ? size[0] - 1 : x;
    y = y < 0 ? 0 : y >= size[1] ? size[1] - 1 : y;
    return (size_t)y * (size_t)size[0] + (size_t)x;
}
{%- endif %}
{%- if means %}

/* A mean within its bounds; or what was averaged, where the mean cannot be trusted. */
static float {{ name }}_kept(int trusted, float mean, float lo, float hi, float own)
{
    if (!trusted || !isfinite(mean))
        return own;
    return mean < lo ? lo : mean > hi ? hi : mean;
}
{%- endif %}
{%- if doubles %}

/* What lies a quarter of the way from one number to another. */
static float {{ name }}_quarter(float a, float b)
{
    return a + 0.25f * (b - a);
}
{%- endif %}
