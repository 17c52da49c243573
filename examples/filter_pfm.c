/* Filters an image with a filter that was exported as C.

       tamis export tamis-formula --without depth --lang c -o tamis_formula.c
       cc -std=c99 -O3 -march=native -fopenmp -I. examples/filter_pfm.c tamis_formula.c -lm -o filter_pfm
       ./filter_pfm color.pfm albedo.pfm normal.pfm clean.pfm

   The header that is exported beside the code says what each input is and how it is prepared. This
   is that for a renderer which has the noisy colour, albedo and normals, and no variances: these
   are estimated. (`-ffp-contract=off`, which gcc's -std=c99 implies, keeps the bits of Tamis.) */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tamis_formula.h"

/* Three planes of width * height numbers, row by row from the top left. */
struct image {
    size_t width, height;
    float *plane[3];
};

static void fail(const char *path, const char *what)
{
    fprintf(stderr, "%s: %s\n", path, what);
    exit(1);
}

static float *numbers(size_t count)
{
    float *made = count > (size_t)-1 / sizeof(float) ? NULL : (float *)malloc(count * sizeof(float));
    if (!made) {
        fprintf(stderr, "out of memory\n");
        exit(1);
    }
    return made;
}

/* Whether this machine puts the lowest byte first. */
static int is_little(void)
{
    const uint16_t one = 1;
    unsigned char first;
    memcpy(&first, &one, 1);
    return first == 1;
}

/* Reads a PFM file of three channels. Its rows go from the bottom up. */
static struct image read_pfm(const char *path)
{
    struct image image;
    double scale;
    FILE *file = fopen(path, "rb");
    if (!file)
        fail(path, "cannot be opened");
    if (fscanf(file, "PF %zu %zu %lf", &image.width, &image.height, &scale) != 3 || fgetc(file) == EOF)
        fail(path, "is no PFM file of three channels (which begins with PF)");
    if (tamis_formula_scratch(image.width, image.height) == 0)
        fail(path, "is empty or too large");
    for (int c = 0; c < 3; ++c)
        image.plane[c] = numbers(image.width * image.height);
    for (size_t y = image.height; y-- > 0;) {
        for (size_t x = 0; x < image.width; ++x) {
            for (int c = 0; c < 3; ++c) {
                unsigned char bytes[4], turned[4];
                float *to = &image.plane[c][y * image.width + x];
                if (fread(bytes, 1, 4, file) != 4)
                    fail(path, "ends too early");
                for (int k = 0; k < 4; ++k)
                    turned[k] = bytes[(scale < 0) == is_little() ? k : 3 - k];
                memcpy(to, turned, 4);
                if (!isfinite(*to))
                    fail(path, "holds numbers that are not finite");
            }
        }
    }
    fclose(file);
    return image;
}

static void write_pfm(const char *path, size_t width, size_t height, const float *rgb)
{
    FILE *file = fopen(path, "wb");
    int written = file && fprintf(file, "PF\n%zu %zu\n%s\n", width, height, is_little() ? "-1.0" : "1.0") > 0;
    for (size_t y = height; written && y-- > 0;)
        written = fwrite(rgb + 3 * y * width, sizeof(float), 3 * width, file) == 3 * width;
    if (!file || fclose(file) != 0 || !written)
        fail(path, "cannot be written");
}

static int ascending(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The median of the image's positive luminances; 1 for an image without any. */
static float exposure(const struct image *color)
{
    const size_t pixels = color->width * color->height;
    float *positive = numbers(pixels), median = 1.0f;
    size_t count = 0;
    for (size_t i = 0; i < pixels; ++i) {
        const float y = 0.2126f * color->plane[0][i] + 0.7152f * color->plane[1][i] + 0.0722f * color->plane[2][i];
        if (y > 0.0f)
            positive[count++] = y;
    }
    qsort(positive, count, sizeof(float), ascending);
    if (count > 0)
        median = positive[(count - 1) / 2];
    free(positive);
    return median;
}

/* The variance of a pixel, from what the least-squares plane through the 3 x 3 pixels around it
   leaves; averaged over the components. */
static float *variance(const struct image *image)
{
    const size_t width = image->width, height = image->height;
    float *out = numbers(width * height);
    for (size_t y = 0; y < height; ++y) {
        for (size_t x = 0; x < width; ++x) {
            const size_t rows[3] = {y > 0 ? y - 1 : 0, y, y + 1 < height ? y + 1 : y};
            const size_t columns[3] = {x > 0 ? x - 1 : 0, x, x + 1 < width ? x + 1 : x};
            double total = 0.0;
            for (int c = 0; c < 3; ++c) {
                const double center = image->plane[c][y * width + x];
                double sum = 0.0, squares = 0.0, right = 0.0, down = 0.0, rest;
                for (int v = 0; v < 3; ++v) {
                    for (int u = 0; u < 3; ++u) {
                        const double d = image->plane[c][rows[v] * width + columns[u]] - center;
                        sum += d;
                        squares += d * d;
                        right += (u - 1) * d;
                        down += (v - 1) * d;
                    }
                }
                rest = squares - sum * sum / 9.0 - (right * right + down * down) / 6.0;
                total += (rest > 0.0 ? rest : 0.0) / 6.0;
            }
            out[y * width + x] = (float)(total / 3.0);
        }
    }
    return out;
}

/* Divides an image by a number, and keeps it within bounds. */
static void prepare(struct image *image, float divisor, float low, float high)
{
    for (int c = 0; c < 3; ++c) {
        for (size_t i = 0; i < image->width * image->height; ++i) {
            const float x = image->plane[c][i] / divisor;
            image->plane[c][i] = x < low ? low : x > high ? high : x;
        }
    }
}

int main(int argc, char **argv)
{
    struct tamis_formula_inputs in;
    struct image color, albedo, normal;
    float *rgb, *scratch;
    if (argc != 5) {
        fprintf(stderr, "usage: %s COLOR.pfm ALBEDO.pfm NORMAL.pfm RESULT.pfm\n", argv[0]);
        return 2;
    }
    color = read_pfm(argv[1]);
    albedo = read_pfm(argv[2]);
    normal = read_pfm(argv[3]);
    if (albedo.width != color.width || albedo.height != color.height)
        fail(argv[2], "is not of the colour's size");
    if (normal.width != color.width || normal.height != color.height)
        fail(argv[3], "is not of the colour's size");

    in.exposure = exposure(&color);
    prepare(&color, in.exposure, -1e18f, 1e18f);
    prepare(&albedo, 1.0f, 0.0f, 1.0f);
    prepare(&normal, 1.0f, -1.0f, 1.0f);
    for (int c = 0; c < 3; ++c) {
        in.color[c] = color.plane[c];
        in.texture[c] = albedo.plane[c];
        in.normal[c] = normal.plane[c];
    }
    in.c_variance = variance(&color);
    in.t_variance = variance(&albedo);
    in.n_variance = variance(&normal);

    rgb = numbers(3 * color.width * color.height);
    scratch = numbers(tamis_formula_scratch(color.width, color.height));
    if (tamis_formula_filter(color.width, color.height, &in, rgb, scratch) != 0)
        fail(argv[1], "cannot be filtered");
    write_pfm(argv[4], color.width, color.height, rgb);
    return 0;
}
