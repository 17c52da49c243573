/* Uses the library as nobody should, and as few do. Ends with 0 if everything came out as the
   header says; sanitizers end it if memory was misused on the way. */

#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <tamis.h>

enum { WIDTH = 40, HEIGHT = 24, PIXELS = WIDTH * HEIGHT };

#define CHECK(what)                                                                      \
    do {                                                                                 \
        if (!(what)) {                                                                   \
            fprintf(stderr, "%s:%d: this does not hold: %s\n", __FILE__, __LINE__, #what); \
            exit(1);                                                                     \
        }                                                                                \
    } while (0)

/* The device's error has this code and says that; it is then gone. */
#define EXPECT(device, code, said) expect(device, code, said, __LINE__)

static void expect(TamisDevice device, TamisError expected, const char *said, int line)
{
    const char *message = "";
    TamisError code = tamisGetDeviceError(device, &message);
    if (code != expected || (code == TAMIS_ERROR_NONE) != (message == NULL) ||
        (message && !strstr(message, said))) {
        fprintf(stderr, "line %d: expected error %d with `%s`, got %d: %s\n", line, expected, said, code,
                message ? message : "no message");
        exit(1);
    }
    CHECK(tamisGetDeviceError(device, NULL) == TAMIS_ERROR_NONE);
}

static void expect_none(TamisDevice device)
{
    EXPECT(device, TAMIS_ERROR_NONE, "");
}

static float color[3 * PIXELS], normal[3 * PIXELS];

static void set(TamisFilter filter, const char *name, void *memory)
{
    tamisSetSharedFilterImage(filter, name, memory, TAMIS_FORMAT_FLOAT3, WIDTH, HEIGHT, 0, 0, 0);
}

static TamisDevice new_device(void)
{
    TamisDevice device = tamisNewDevice(TAMIS_DEVICE_TYPE_CPU);
    tamisCommitDevice(device);
    expect_none(device);
    return device;
}

/* The result for what is set, in memory of its own. */
static float *result(TamisDevice device, TamisFilter filter)
{
    float *out = calloc(3 * PIXELS, sizeof(float));
    CHECK(out);
    set(filter, "output", out);
    tamisCommitFilter(filter);
    tamisExecuteFilter(filter);
    expect_none(device);
    return out;
}

static void handles_may_be_null(void)
{
    const TamisError argument = TAMIS_ERROR_INVALID_ARGUMENT;
    expect_none(NULL);
    tamisRetainDevice(NULL);
    tamisReleaseDevice(NULL);
    tamisRetainFilter(NULL);
    tamisReleaseFilter(NULL);
    expect_none(NULL);
    tamisCommitDevice(NULL);
    EXPECT(NULL, argument, "device is NULL");
    tamisSetDeviceInt(NULL, "numThreads", 1);
    EXPECT(NULL, argument, "device is NULL");
    tamisSetDeviceBool(NULL, "setAffinity", true);
    tamisSetDeviceString(NULL, "backend", "jit");
    tamisSetDeviceErrorFunction(NULL, NULL, NULL);
    CHECK(tamisGetDeviceInt(NULL, "version") == 0);
    CHECK(tamisGetDeviceString(NULL, "backend") == NULL);
    CHECK(tamisNewFilter(NULL, "RT") == NULL);
    EXPECT(NULL, argument, "device is NULL");
    set(NULL, "color", color);
    EXPECT(NULL, argument, "filter is NULL");
    tamisUnsetFilterImage(NULL, "color");
    tamisSetFilterBool(NULL, "hdr", true);
    tamisSetFilterInt(NULL, "quality", 0);
    tamisSetFilterFloat(NULL, "strength", 1);
    tamisSetFilterString(NULL, "filter", "RT");
    CHECK(!tamisGetFilterBool(NULL, "hdr") && tamisGetFilterInt(NULL, "quality") == 0);
    CHECK(tamisGetFilterFloat(NULL, "strength") == 0 && tamisGetFilterString(NULL, "notes") == NULL);
    tamisSetFilterProgressMonitorFunction(NULL, NULL, NULL);
    tamisCommitFilter(NULL);
    tamisExecuteFilter(NULL);
    EXPECT(NULL, argument, "filter is NULL");
    CHECK(tamisNewDevice(-1) == NULL);
    EXPECT(NULL, argument, "no type of device");
    CHECK(tamisNewDevice(1000000) == NULL);
    EXPECT(NULL, argument, "AUTO (3)");
}

static void count_errors(void *user, TamisError code, const char *message)
{
    CHECK(code != TAMIS_ERROR_NONE && message && *message);
    ++*(int *)user;
}

static void devices_say_what_is_wrong(void)
{
    int errors = 0;
    TamisDevice device = tamisNewDevice(TAMIS_DEVICE_TYPE_DEFAULT);
    tamisSetDeviceErrorFunction(device, count_errors, &errors);
    CHECK(tamisGetVersion() == TAMIS_VERSION && tamisGetDeviceInt(device, "version") == TAMIS_VERSION);
    CHECK(tamisNewFilter(device, "RT") == NULL);
    EXPECT(device, TAMIS_ERROR_INVALID_OPERATION, "tamisCommitDevice");
    CHECK(tamisGetDeviceString(device, "backend") == NULL);
    EXPECT(device, TAMIS_ERROR_INVALID_OPERATION, "tamisCommitDevice");
    tamisSetDeviceInt(device, "threads", 2);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "there are: numThreads, gpuMemoryMB");
    tamisSetDeviceInt(device, "numThreads", -1);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "from 0 to 4096");
    tamisSetDeviceInt(device, NULL, 2);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "the name is NULL");
    tamisSetDeviceInt(device, "\xff", 2);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "not UTF-8");
    tamisSetDeviceBool(device, "setAffinity", false);
    tamisSetDeviceString(device, "backend", "cuda");
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "auto, jit, interp, gpu, exact");
    tamisSetDeviceString(device, "precision", "low");
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "standard, fast");
    tamisSetDeviceString(device, "gpu", NULL);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "the value is NULL");
    CHECK(errors == 9);
    /* The first error is kept, and the function hears of both. */
    tamisSetDeviceInt(device, "first", 1);
    tamisSetDeviceInt(device, "second", 1);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "first");
    CHECK(errors == 11);
    tamisSetDeviceInt(device, "numThreads", 2);
    tamisSetDeviceString(device, "gpu", "no such card");
    tamisSetDeviceString(device, "backend", "gpu");
    tamisCommitDevice(device);
    EXPECT(device, TAMIS_ERROR_UNSUPPORTED_HARDWARE, "`gpu` cannot be opened");
    tamisSetDeviceString(device, "backend", "interp");
    tamisCommitDevice(device);
    expect_none(device);
    CHECK(strcmp(tamisGetDeviceString(device, "backend"), "interp") == 0);
    CHECK(tamisGetDeviceInt(device, "numThreads") == 2);
    TamisFilter filter = tamisNewFilter(device, "no-such-filter");
    CHECK(filter == NULL);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "tamis-fast");
    CHECK(tamisNewFilter(device, NULL) == NULL);
    EXPECT(device, TAMIS_ERROR_INVALID_ARGUMENT, "filter's type is NULL");
    tamisReleaseDevice(device);
}

static void filters_say_what_is_wrong(void)
{
    const TamisError argument = TAMIS_ERROR_INVALID_ARGUMENT, operation = TAMIS_ERROR_INVALID_OPERATION;
    static float out[3 * PIXELS];
    TamisDevice device = new_device();
    TamisFilter filter = tamisNewFilter(device, "RT");
    tamisExecuteFilter(filter);
    EXPECT(device, operation, "tamisCommitFilter");
    tamisCommitFilter(filter);
    EXPECT(device, operation, "`output`");
    set(filter, "output", out);
    tamisCommitFilter(filter);
    EXPECT(device, operation, "`color`");
    set(filter, "colour", color);
    EXPECT(device, argument, "color, colorVariance");
    set(filter, NULL, color);
    EXPECT(device, argument, "image's name is NULL");
    set(filter, "color", NULL);
    EXPECT(device, argument, "color: its memory is NULL");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_UNDEFINED, WIDTH, HEIGHT, 0, 0, 0);
    EXPECT(device, argument, "0 is no format");
    tamisSetSharedFilterImage(filter, "color", color, -7, WIDTH, HEIGHT, 0, 0, 0);
    EXPECT(device, argument, "-7 is no format");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_HALF2, WIDTH, HEIGHT, 0, 0, 0);
    EXPECT(device, argument, "2 components, but 3");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_FLOAT3, WIDTH, 0, 0, 0, 0);
    EXPECT(device, argument, "40 x 0");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_FLOAT3, WIDTH, HEIGHT, 0, 8, 0);
    EXPECT(device, argument, "pixels of 12 bytes cannot lie 8");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_FLOAT3, WIDTH, HEIGHT, 0, 0, 12);
    EXPECT(device, argument, "rows of 480 bytes cannot lie 12");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_FLOAT3, SIZE_MAX, SIZE_MAX, 0, 0, 0);
    EXPECT(device, argument, "larger than any memory");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_FLOAT3, WIDTH, HEIGHT, SIZE_MAX, 0, 0);
    EXPECT(device, argument, "larger than any memory");
    tamisSetSharedFilterImage(filter, "color", color, TAMIS_FORMAT_FLOAT3, WIDTH - 1, HEIGHT, 0, 0, 0);
    tamisCommitFilter(filter);
    EXPECT(device, operation, "39 x 24 pixels, but `output` 40 x 24");
    set(filter, "color", color);
    tamisExecuteFilter(filter);
    EXPECT(device, operation, "changed since it was committed");
    tamisSetFilterBool(filter, "HDR", true);
    EXPECT(device, argument, "hdr, srgb, cleanAux");
    tamisSetFilterInt(filter, "quality", 1);
    EXPECT(device, argument, "TAMIS_QUALITY_DEFAULT");
    tamisSetFilterFloat(filter, "strength", (float)NAN);
    EXPECT(device, argument, "from 0 to 1");
    tamisSetFilterString(filter, "repair", "please");
    EXPECT(device, argument, "median, error, none");
    tamisSetFilterString(filter, "filter", "no-such-filter");
    EXPECT(device, argument, "tamis-fast");
    CHECK(tamisGetFilterFloat(filter, "filteringSeconds") == 0);
    EXPECT(device, operation, "not executed yet");
    CHECK(tamisGetFilterFloat(filter, "seconds") == 0);
    EXPECT(device, argument, "preparingSeconds, planningSeconds");
    CHECK(tamisGetFilterInt(filter, "kept") == 0);
    EXPECT(device, argument, "keptPixels");
    CHECK(tamisGetFilterString(filter, "name") == NULL);
    EXPECT(device, argument, "filter, notes, backend");
    /* What is without effect is taken all the same. */
    tamisSetFilterBool(filter, "cleanAux", true);
    tamisSetFilterFloat(filter, "inputScale", (float)NAN);
    tamisSetFilterInt(filter, "maxMemoryMB", 512);
    CHECK(tamisGetFilterBool(filter, "hdr") && tamisGetFilterInt(filter, "maxMemoryMB") == 512);
    tamisCommitFilter(filter);
    float kept = color[100];
    color[100] = (float)NAN;
    tamisExecuteFilter(filter);
    expect_none(device);
    CHECK(tamisGetFilterFloat(filter, "filteringSeconds") > 0 && isfinite(out[100]));
    CHECK(strcmp(tamisGetFilterString(filter, "filter"), "tamis") == 0);
    CHECK(strcmp(tamisGetFilterString(filter, "backend"), tamisGetDeviceString(device, "backend")) == 0);
    CHECK(strstr(tamisGetFilterString(filter, "notes"), "1 bad pixel"));
    tamisSetFilterString(filter, "repair", "error");
    tamisCommitFilter(filter);
    tamisExecuteFilter(filter);
    EXPECT(device, operation, "x = 33, y = 0");
    color[100] = kept;
    /* A filter that cannot do without direct light. */
    tamisSetFilterString(filter, "filter", "kan2017");
    tamisCommitFilter(filter);
    EXPECT(device, operation, "`kan2017` cannot do without images that are not set: ");
    /* A filter outlives its device's handle. */
    tamisReleaseDevice(device);
    tamisSetFilterString(filter, "filter", "RT");
    tamisCommitFilter(filter);
    tamisRetainFilter(filter);
    tamisReleaseFilter(filter);
    tamisExecuteFilter(filter);
    CHECK(tamisGetFilterFloat(filter, "filteringSeconds") > 0);
    tamisReleaseFilter(filter);
}

static void images_of_any_layout_have_one_result(void)
{
    TamisDevice device = new_device();
    TamisFilter filter = tamisNewFilter(device, "RT");
    set(filter, "color", color);
    set(filter, "normal", normal);
    float *expected = result(device, filter);

    /* Four components, room between pixels and rows, an odd offset; filtered in place. */
    enum { PIXEL = 21, ROW = WIDTH * PIXEL + 5, OFFSET = 3 };
    unsigned char *apart = malloc(OFFSET + (HEIGHT - 1) * ROW + (WIDTH - 1) * PIXEL + 16);
    CHECK(apart);
    memset(apart, 0x5a, OFFSET + (HEIGHT - 1) * ROW + (WIDTH - 1) * PIXEL + 16);
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x)
            memcpy(apart + OFFSET + y * ROW + x * PIXEL, color + 3 * (y * WIDTH + x), 12);
    const char *const both[] = {"color", "output"};
    for (int k = 0; k < 2; ++k)
        tamisSetSharedFilterImage(filter, both[k], apart, TAMIS_FORMAT_FLOAT4, WIDTH, HEIGHT, OFFSET, PIXEL, ROW);
    tamisCommitFilter(filter);
    tamisExecuteFilter(filter);
    expect_none(device);
    for (int y = 0; y < HEIGHT; ++y) {
        for (int x = 0; x < WIDTH; ++x) {
            unsigned char *pixel = apart + OFFSET + y * ROW + x * PIXEL;
            CHECK(memcmp(pixel, expected + 3 * (y * WIDTH + x), 12) == 0);
            CHECK(pixel[12] == 0x5a && pixel[15] == 0x5a);
        }
    }
    free(apart);

    /* The result begins in the middle of the colour: all of that is read first. */
    float *overlapping = malloc(sizeof color + sizeof color / 2);
    CHECK(overlapping);
    memcpy(overlapping, color, sizeof color);
    set(filter, "color", overlapping);
    set(filter, "output", overlapping + 3 * PIXELS / 2);
    tamisCommitFilter(filter);
    tamisExecuteFilter(filter);
    expect_none(device);
    CHECK(memcmp(overlapping + 3 * PIXELS / 2, expected, sizeof color) == 0);
    free(overlapping);

    /* Halves: what 1 and 0 are, all over. Grey stays grey. */
    uint16_t *halves = malloc(4 * PIXELS * sizeof(uint16_t)), *out = calloc(3 * PIXELS, sizeof(uint16_t));
    CHECK(halves && out);
    for (int k = 0; k < 4 * PIXELS; ++k)
        halves[k] = k % 4 == 3 ? 0x7e00 /* not a number, not read */ : 0x3c00 /* 1 */;
    tamisUnsetFilterImage(filter, "normal");
    tamisSetSharedFilterImage(filter, "color", halves, TAMIS_FORMAT_HALF4, WIDTH, HEIGHT, 0, 0, 0);
    tamisSetSharedFilterImage(filter, "output", out, TAMIS_FORMAT_HALF3, WIDTH, HEIGHT, 0, 0, 0);
    tamisCommitFilter(filter);
    tamisExecuteFilter(filter);
    expect_none(device);
    for (int k = 0; k < 3 * PIXELS; ++k)
        CHECK(out[k] >= 0x3bff && out[k] <= 0x3c01);
    free(halves);
    free(out);
    free(expected);
    tamisReleaseFilter(filter);
    tamisReleaseDevice(device);
}

static void ranges_and_curves_are_kept(void)
{
    static float bright[3 * PIXELS];
    TamisDevice device = new_device();
    TamisFilter filter = tamisNewFilter(device, "tamis-formula");
    for (int k = 0; k < 3 * PIXELS; ++k)
        bright[k] = 2 * color[k];
    set(filter, "color", bright);
    float *open = result(device, filter);
    tamisSetFilterBool(filter, "hdr", false);
    float *clamped = result(device, filter);
    int above = 0;
    for (int k = 0; k < 3 * PIXELS; ++k) {
        above += open[k] > 1;
        CHECK(clamped[k] == (open[k] > 1 ? 1 : open[k]));
    }
    CHECK(above > 0);
    /* A grey of 0.5 is one of 0.2140 in linear light, and comes back. */
    for (int k = 0; k < 3 * PIXELS; ++k)
        bright[k] = 0.5f;
    tamisSetFilterBool(filter, "srgb", true);
    float *encoded = result(device, filter);
    for (int k = 0; k < 3 * PIXELS; ++k)
        CHECK(fabsf(encoded[k] - 0.5f) < 1e-4f);
    set(filter, "colorVariance", bright);
    tamisCommitFilter(filter);
    EXPECT(device, TAMIS_ERROR_INVALID_OPERATION, "variances of encoded colours");
    free(open);
    free(clamped);
    free(encoded);
    tamisReleaseFilter(filter);
    tamisReleaseDevice(device);
}

/* What a progress monitor is told, and what it does. */
struct watch {
    TamisFilter filter;
    double last, stop_at;
    int calls;
};

static bool on_progress(void *user, double n)
{
    struct watch *watch = user;
    CHECK(n >= 0 && n <= 1 && n > watch->last);
    watch->last = n;
    ++watch->calls;
    /* Its own filter is in use: an error, and no deadlock. */
    tamisSetFilterBool(watch->filter, "hdr", false);
    return n < watch->stop_at;
}

struct nest {
    TamisFilter other;
    int runs;
};

/* Filters another image amid the first one, on one of the device's threads. */
static bool on_nested_progress(void *user, double n)
{
    struct nest *nest = user;
    if (n > 0 && n < 1) {
        tamisExecuteFilter(nest->other);
        ++nest->runs;
    }
    return true;
}

static void a_monitor_may_filter_another_image(void)
{
    TamisDevice device = new_device();
    TamisFilter outer = tamisNewFilter(device, "RT"), inner = tamisNewFilter(device, "tamis-formula");
    set(outer, "color", color);
    set(inner, "color", color);
    float *alone[] = {result(device, outer), result(device, inner)};
    float *nested = calloc(3 * PIXELS, sizeof(float));
    CHECK(nested);
    set(inner, "output", nested);
    tamisCommitFilter(inner);
    struct nest nest = {inner, 0};
    tamisSetFilterProgressMonitorFunction(outer, on_nested_progress, &nest);
    float *amid = result(device, outer);
    CHECK(nest.runs > 0);
    CHECK(memcmp(nested, alone[1], sizeof color) == 0 && memcmp(amid, alone[0], sizeof color) == 0);
    free(alone[0]);
    free(alone[1]);
    free(nested);
    free(amid);
    tamisReleaseFilter(inner);
    tamisReleaseFilter(outer);
    tamisReleaseDevice(device);
}

static void monitors_watch_and_stop(void)
{
    TamisDevice device = new_device();
    TamisFilter filter = tamisNewFilter(device, "RT");
    set(filter, "color", color);
    float *expected = result(device, filter), *out = calloc(3 * PIXELS, sizeof(float));
    CHECK(out);
    int errors = 0;
    const double stops[] = {2, 0, 0.5, 1};
    for (int k = 0; k < 4; ++k) {
        struct watch watch = {filter, -1, stops[k], 0};
        tamisSetFilterProgressMonitorFunction(filter, on_progress, &watch);
        set(filter, "output", out);
        tamisCommitFilter(filter);
        /* Threads of the device tell of the filter's misuse each for itself; so listen. */
        tamisSetDeviceErrorFunction(device, count_errors, &errors);
        tamisExecuteFilter(filter);
        tamisSetDeviceErrorFunction(device, NULL, NULL);
        TamisError first = tamisGetDeviceError(device, NULL);
        CHECK(first == TAMIS_ERROR_INVALID_OPERATION && errors >= watch.calls);
        CHECK(watch.calls >= (k == 1 ? 1 : 2));
        if (k == 0) {
            CHECK(watch.last == 1 && memcmp(out, expected, sizeof color) == 0);
            memset(out, 0, sizeof color);
        } else {
            CHECK(watch.last >= stops[k]);
            for (int n = 0; n < 3 * PIXELS; ++n)
                CHECK(out[n] == 0);
            CHECK(tamisGetFilterString(filter, "notes") == NULL);
            EXPECT(device, TAMIS_ERROR_INVALID_OPERATION, "latest run failed");
        }
        CHECK(tamisGetFilterBool(filter, "hdr"));
        errors = 0;
    }
    /* Whoever only stops gets an error that says so. */
    struct watch quiet = {NULL, -1, 0.5, 0};
    tamisSetFilterProgressMonitorFunction(filter, on_progress, &quiet);
    tamisExecuteFilter(filter);
    EXPECT(device, TAMIS_ERROR_CANCELLED, "asked to stop");
    tamisSetFilterProgressMonitorFunction(filter, NULL, NULL);
    tamisExecuteFilter(filter);
    expect_none(device);
    CHECK(memcmp(out, expected, sizeof color) == 0);
    free(expected);
    free(out);
    tamisReleaseFilter(filter);
    tamisReleaseDevice(device);
}

struct worker {
    TamisDevice device;
    TamisFilter shared;
    float *expected;
};

/* Filters on its own, and beside that uses a filter that others use. */
static void *work(void *user)
{
    struct worker *worker = user;
    TamisFilter own = tamisNewFilter(worker->device, "RT");
    set(own, "color", color);
    for (int k = 0; k < 3; ++k) {
        float *out = result(worker->device, own);
        CHECK(memcmp(out, worker->expected, sizeof color) == 0);
        free(out);
        tamisExecuteFilter(worker->shared);
        const char *message;
        TamisError code = tamisGetDeviceError(worker->device, &message);
        CHECK(code == TAMIS_ERROR_NONE || (code == TAMIS_ERROR_INVALID_OPERATION && strstr(message, "another call")));
    }
    tamisReleaseFilter(own);
    /* Errors are this thread's own, those without a device too. */
    tamisSetDeviceInt(worker->device, "mine", 1);
    tamisCommitDevice(NULL);
    EXPECT(worker->device, TAMIS_ERROR_INVALID_ARGUMENT, "`mine`");
    EXPECT(NULL, TAMIS_ERROR_INVALID_ARGUMENT, "device is NULL");
    return NULL;
}

static void threads_share_a_device(void)
{
    static float out[3 * PIXELS];
    TamisDevice device = new_device();
    TamisFilter shared = tamisNewFilter(device, "RT");
    set(shared, "color", color);
    float *expected = result(device, shared);
    set(shared, "output", out);
    tamisCommitFilter(shared);
    struct worker worker = {device, shared, expected};
    pthread_t threads[2];
    for (int k = 0; k < 2; ++k)
        CHECK(pthread_create(&threads[k], NULL, work, &worker) == 0);
    for (int k = 0; k < 2; ++k)
        CHECK(pthread_join(threads[k], NULL) == 0);
    expect_none(device);
    CHECK(memcmp(out, expected, sizeof color) == 0);
    free(expected);
    tamisReleaseFilter(shared);
    tamisReleaseDevice(device);
}

int main(void)
{
    /* A wall with noise that never repeats. */
    uint32_t state = 1;
    for (int k = 0; k < 3 * PIXELS; ++k) {
        state = 1664525u * state + 1013904223u;
        color[k] = 0.2f + 0.6f * (float)(state >> 8) / 16777216.0f;
        normal[k] = k % 3 == (k / 3 % WIDTH < WIDTH / 2 ? 0 : 2);
    }
    handles_may_be_null();
    devices_say_what_is_wrong();
    filters_say_what_is_wrong();
    images_of_any_layout_have_one_result();
    ranges_and_curves_are_kept();
    monitors_watch_and_stop();
    a_monitor_may_filter_another_image();
    threads_share_a_device();
    puts("all of it holds");
    return 0;
}
