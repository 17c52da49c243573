/* Denoises a render in memory with the C library, as a renderer would.

       scripts/install_capi /usr/local
       cc -std=c99 examples/embed.c $(pkg-config --cflags --libs tamis) -o embed
       ./embed clean.pfm color.pfm [albedo.pfm [normal.pfm]]

   A PFM file has a header of three lines and then, in floats, the rows from the bottom up. Nothing
   is turned here: all images are upside down, and so is the result. This program reads the byte
   order of its own machine. */

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include <tamis.h>

/* Three floats per pixel, row by row. */
struct image {
    size_t width, height;
    float *pixels;
};

static void fail(const char *path, const char *what)
{
    fprintf(stderr, "%s: %s\n", path, what);
    exit(1);
}

static struct image new_image(size_t width, size_t height, const char *path)
{
    struct image image = {width, height, NULL};
    if (width == 0 || height > (size_t)-1 / (3 * sizeof(float)) / width)
        fail(path, "is empty, or too large for this machine");
    image.pixels = malloc(3 * sizeof(float) * width * height);
    if (!image.pixels)
        fail(path, "there is too little memory for its pixels");
    return image;
}

static bool is_little_endian(void)
{
    const unsigned one = 1;
    return *(const unsigned char *)&one == 1;
}

static struct image read_pfm(const char *path)
{
    size_t width, height;
    double scale;
    FILE *file = fopen(path, "rb");
    if (!file)
        fail(path, "cannot be opened");
    if (fscanf(file, "PF %zu %zu %lf", &width, &height, &scale) != 3 || fgetc(file) == EOF)
        fail(path, "is no PFM file of three channels (these begin with PF)");
    if ((scale < 0) != is_little_endian())
        fail(path, "has the byte order of another kind of machine");
    struct image image = new_image(width, height, path);
    if (fread(image.pixels, 3 * sizeof(float), width * height, file) != width * height)
        fail(path, "ends too early");
    fclose(file);
    return image;
}

static void write_pfm(const char *path, struct image image)
{
    FILE *file = fopen(path, "wb");
    if (!file)
        fail(path, "cannot be written");
    size_t pixels = image.width * image.height;
    fprintf(file, "PF\n%zu %zu\n%s\n", image.width, image.height, is_little_endian() ? "-1.0" : "1.0");
    size_t written = fwrite(image.pixels, 3 * sizeof(float), pixels, file);
    if (fclose(file) != 0 || written != pixels)
        fail(path, "could not be written whole; is the disk full?");
}

/* Is told of every error, before the call that failed returns. */
static void on_error(void *user, TamisError code, const char *message)
{
    (void)user;
    fprintf(stderr, "tamis: error %d: %s\n", code, message);
}

/* Is told how far it is, from any thread; false would stop it. */
static bool on_progress(void *user, double n)
{
    (void)user;
    fprintf(stderr, "\r%3.0f%%%s", 100 * n, n < 1 ? "" : "\n");
    return true;
}

int main(int count, char **arguments)
{
    static const char *const names[] = {"color", "albedo", "normal"};
    if (count < 3 || count > 5)
        fail("usage", "embed CLEAN.pfm COLOR.pfm [ALBEDO.pfm [NORMAL.pfm]]");

    /* A device is made once, and serves every frame. */
    TamisDevice device = tamisNewDevice(TAMIS_DEVICE_TYPE_DEFAULT);
    tamisSetDeviceErrorFunction(device, on_error, NULL);
    tamisCommitDevice(device);

    /* So is a filter, which keeps the code that it makes. */
    TamisFilter filter = tamisNewFilter(device, "RT");
    tamisSetFilterProgressMonitorFunction(filter, on_progress, NULL);

    /* A renderer has these in memory already. */
    struct image images[3];
    int inputs = count - 2;
    for (int k = 0; k < inputs; ++k) {
        images[k] = read_pfm(arguments[2 + k]);
        tamisSetSharedFilterImage(filter, names[k], images[k].pixels, TAMIS_FORMAT_FLOAT3,
                                  images[k].width, images[k].height, 0, 0, 0);
    }
    struct image clean = new_image(images[0].width, images[0].height, arguments[1]);
    tamisSetSharedFilterImage(filter, "output", clean.pixels, TAMIS_FORMAT_FLOAT3, clean.width,
                              clean.height, 0, 0, 0);
    tamisCommitFilter(filter);

    /* This is what every frame takes. */
    tamisExecuteFilter(filter);
    bool is_done = tamisGetDeviceError(device, NULL) == TAMIS_ERROR_NONE;
    if (is_done) {
        printf("%s: %.3f s, and %.3f s for making the code\n", tamisGetFilterString(filter, "filter"),
               tamisGetFilterFloat(filter, "preparingSeconds") + tamisGetFilterFloat(filter, "filteringSeconds"),
               tamisGetFilterFloat(filter, "planningSeconds") + tamisGetFilterFloat(filter, "compilationSeconds"));
        const char *notes = tamisGetFilterString(filter, "notes");
        if (*notes)
            printf("%s\n", notes);
        write_pfm(arguments[1], clean);
    }

    tamisReleaseFilter(filter);
    tamisReleaseDevice(device);
    for (int k = 0; k < inputs; ++k)
        free(images[k].pixels);
    free(clean.pixels);
    return is_done ? 0 : 1;
}
