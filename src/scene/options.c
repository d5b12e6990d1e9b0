#include "scene/options.h"

#include "scene/yaml.h"

#include <assert.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#define CHOICE_NAME(name, yaml) #yaml,
static const char *const method_names[] = {PLIANT_METHOD_LIST(CHOICE_NAME) NULL};
static const char *const submesh_names[] = {PLIANT_SUBMESH_EXTENT_LIST(CHOICE_NAME) NULL};
static const char *const backend_names[] = {PLIANT_BACKEND_LIST(CHOICE_NAME) NULL};
static const char *const preconditioner_names[] = {PLIANT_PRECONDITIONER_LIST(CHOICE_NAME) NULL};
static const char *const scalar_names[] = {PLIANT_SCALAR_LIST(CHOICE_NAME) NULL};
static const char *const solver_names[] = {PLIANT_SOLVER_LIST(CHOICE_NAME) NULL};
static const char *const mesh_names[] = {PLIANT_MESH_LIST(CHOICE_NAME) NULL};
static const char *const elasticity_names[] = {PLIANT_ELASTICITY_LIST(CHOICE_NAME) NULL};
static const char *const element_names[] = {PLIANT_ELEMENT_LIST(CHOICE_NAME) NULL};
static const char *const warp_names[] = {PLIANT_WARP_LIST(CHOICE_NAME) NULL};
static const char *const segment_names[] = {PLIANT_SEGMENT_LIST(CHOICE_NAME) NULL};
static const char *const law_names[] = {PLIANT_LAW_LIST(CHOICE_NAME) NULL};
static const char *const cut_names[] = {PLIANT_CUT_LIST(CHOICE_NAME) NULL};
static const char *const trigger_names[] = {PLIANT_TRIGGER_LIST(CHOICE_NAME) NULL};
static const char *const measure_names[] = {PLIANT_MEASURE_LIST(CHOICE_NAME) NULL};
static const char *const grasp_names[] = {PLIANT_GRASP_LIST(CHOICE_NAME) NULL};
static const char *const response_names[] = {PLIANT_RESPONSE_LIST(CHOICE_NAME) NULL};
#undef CHOICE_NAME

/* enumerations are read and written through an int */
_Static_assert(sizeof(pliant_method) == sizeof(int) && sizeof(pliant_submesh_extent) == sizeof(int) &&
                   sizeof(pliant_backend_choice) == sizeof(int) &&
                   sizeof(pliant_preconditioner_choice) == sizeof(int) && sizeof(pliant_scalar) == sizeof(int) &&
                   sizeof(pliant_solver_kind) == sizeof(int) && sizeof(pliant_law) == sizeof(int) &&
                   sizeof(pliant_mesh_kind) == sizeof(int) && sizeof(pliant_warp_kind) == sizeof(int) &&
                   sizeof(pliant_segment_kind) == sizeof(int) && sizeof(pliant_measure) == sizeof(int) &&
                   sizeof(pliant_response) == sizeof(int) && sizeof(pliant_grasp_kind) == sizeof(int),
               "choices have the size of an int");

/* kind, numeric default, text default, names of the enumeration */
#define KIND_BOOL(value) PLIANT_OPTION_BOOL, value, NULL, NULL
#define KIND_INT(value) PLIANT_OPTION_INT, value, NULL, NULL
#define KIND_INT3(value) PLIANT_OPTION_INT3, value, NULL, NULL
#define KIND_REAL(value) PLIANT_OPTION_REAL, value, NULL, NULL
#define KIND_REAL3(value) PLIANT_OPTION_REAL3, value, NULL, NULL
#define KIND_LENGTH(value) PLIANT_OPTION_LENGTH, value, NULL, NULL
#define KIND_STRING(value) PLIANT_OPTION_STRING, 0, value, NULL
#define KIND_METHOD(value) PLIANT_OPTION_CHOICE, value, NULL, method_names
#define KIND_SUBMESH(value) PLIANT_OPTION_CHOICE, value, NULL, submesh_names
#define KIND_BACKEND(value) PLIANT_OPTION_CHOICE, value, NULL, backend_names
#define KIND_PRECONDITIONER(value) PLIANT_OPTION_CHOICE, value, NULL, preconditioner_names
#define KIND_SCALAR(value) PLIANT_OPTION_CHOICE, value, NULL, scalar_names
#define KIND_SOLVER(value) PLIANT_OPTION_CHOICE, value, NULL, solver_names
#define KIND_MESH(value) PLIANT_OPTION_CHOICE, value, NULL, mesh_names
#define KIND_ELASTICITY(value) PLIANT_OPTION_CHOICE, value, NULL, elasticity_names
#define KIND_ELEMENT(value) PLIANT_OPTION_CHOICE, value, NULL, element_names
#define KIND_WARP(value) PLIANT_OPTION_CHOICE, value, NULL, warp_names
#define KIND_SEGMENT(value) PLIANT_OPTION_CHOICE, value, NULL, segment_names
#define KIND_CUT(value) PLIANT_OPTION_CHOICE, value, NULL, cut_names
#define KIND_TRIGGER(value) PLIANT_OPTION_CHOICE, value, NULL, trigger_names
#define KIND_MEASURE(value) PLIANT_OPTION_CHOICE, value, NULL, measure_names
#define KIND_GRASP(value) PLIANT_OPTION_CHOICE, value, NULL, grasp_names
#define KIND_RESPONSE(value) PLIANT_OPTION_CHOICE, value, NULL, response_names
#define KIND_LAW(value) PLIANT_OPTION_CHOICE, value, NULL, law_names

/* convert one row of a group's list to a table entry; the second macro expands KIND_ to its four values */
#define ROW(group, kind, name, value, low, high, unit, text) \
    ENTRY(group, name, low, high, unit, text, KIND_##kind(value))
#define ENTRY(...) ENTRY_OF(__VA_ARGS__)
#define ENTRY_OF(group_, name_, low_, high_, unit_, text_, kind_, value_, string_, names_)                       \
    {.group = #group_, .name = #name_, .unit = unit_, .text = text_, .string_value = string_, .kind = kind_,     \
     .offset = offsetof(pliant_scene, group_.name_), .value = value_, .low = low_, .high = high_, .names = names_},

#define SCAN_ROW(...) ROW(scan, __VA_ARGS__)
#define SEGMENT_ROW(...) ROW(segment, __VA_ARGS__)
#define MATERIAL_ROW(...) ROW(material, __VA_ARGS__)
#define MESH_ROW(...) ROW(mesh, __VA_ARGS__)
#define ELEMENT_ROW(...) ROW(element, __VA_ARGS__)
#define MODEL_ROW(...) ROW(model, __VA_ARGS__)
#define SOLVER_ROW(...) ROW(solver, __VA_ARGS__)
#define CHOOSE_ROW(...) ROW(choose, __VA_ARGS__)
#define TLED_ROW(...) ROW(tled, __VA_ARGS__)
#define GROUND_ROW(...) ROW(ground, __VA_ARGS__)
#define GRASP_ROW(...) ROW(grasp, __VA_ARGS__)
#define CONTACT_ROW(...) ROW(contact, __VA_ARGS__)
#define CUT_ROW(...) ROW(cut, __VA_ARGS__)
#define WARP_ROW(...) ROW(warp, __VA_ARGS__)
#define OUTPUT_ROW(...) ROW(output, __VA_ARGS__)

static const pliant_option table[] = {
    PLIANT_SCENE_SCAN(SCAN_ROW) PLIANT_SCENE_SEGMENT(SEGMENT_ROW) PLIANT_SCENE_MATERIAL(MATERIAL_ROW)
        PLIANT_SCENE_MESH(MESH_ROW) PLIANT_SCENE_ELEMENT(ELEMENT_ROW) PLIANT_SCENE_MODEL(MODEL_ROW)
            PLIANT_SCENE_SOLVER(SOLVER_ROW) PLIANT_SCENE_CHOOSE(CHOOSE_ROW) PLIANT_SCENE_TLED(TLED_ROW)
                PLIANT_SCENE_GROUND(GROUND_ROW) PLIANT_SCENE_GRASP(GRASP_ROW) PLIANT_SCENE_CONTACT(CONTACT_ROW)
                    PLIANT_SCENE_CUT(CUT_ROW) PLIANT_SCENE_WARP(WARP_ROW) PLIANT_SCENE_OUTPUT(OUTPUT_ROW)};
enum { NUM_OPTIONS = sizeof table / sizeof *table, TEXT_SIZE = 128 };

/* one entry for every option of every group; detects a group missing above */
#define COUNT_OPTION(kind, name, value, low, high, unit, text) +1
#define COUNT_GROUP(group, list) list(COUNT_OPTION)
_Static_assert((int)NUM_OPTIONS == 0 PLIANT_SCENE_GROUPS(COUNT_GROUP), "a group of the scene is not in the table");

static pliant_option_info infos[NUM_OPTIONS];
static char default_texts[NUM_OPTIONS][TEXT_SIZE], range_texts[NUM_OPTIONS][TEXT_SIZE];
static pthread_once_t described = PTHREAD_ONCE_INIT;

static int words_of(const pliant_option *option)
{
    return option->kind == PLIANT_OPTION_INT3 || option->kind == PLIANT_OPTION_REAL3 ? 3 : 1;
}

static bool is_auto(const pliant_option *option, double value)
{
    return option->kind == PLIANT_OPTION_LENGTH && value == PLIANT_AUTO_LENGTH;
}

static void describe(void)
{
    static const char *const kinds[] = {"bool", "int", "int3", "real", "real3", "length", "string", "choice"};
    static_assert(sizeof kinds / sizeof *kinds == PLIANT_OPTION_CHOICE + 1, "each kind of option has a name");
    for (int i = 0; i < NUM_OPTIONS; ++i) {
        const pliant_option *o = &table[i];
        char *value = default_texts[i], *range = range_texts[i];
        switch (o->kind) {
        case PLIANT_OPTION_BOOL:
            snprintf(value, TEXT_SIZE, "%s", o->value != 0.0 ? "true" : "false");
            snprintf(range, TEXT_SIZE, "true | false");
            break;
        case PLIANT_OPTION_STRING: snprintf(value, TEXT_SIZE, "%s", o->string_value); break;
        case PLIANT_OPTION_CHOICE:
            snprintf(value, TEXT_SIZE, "%s", o->names[(int)o->value]);
            for (int k = 0; o->names[k]; ++k)
                snprintf(range + strlen(range), TEXT_SIZE - strlen(range), "%s%s", k ? " | " : "", o->names[k]);
            break;
        default:
            if (words_of(o) == 3) snprintf(value, TEXT_SIZE, "%g %g %g", o->value, o->value, o->value);
            else if (is_auto(o, o->value)) snprintf(value, TEXT_SIZE, "auto");
            else snprintf(value, TEXT_SIZE, "%g", o->value);
            snprintf(range, TEXT_SIZE, "%g .. %g%s", o->low, o->high, o->kind == PLIANT_OPTION_LENGTH ? " | auto" : "");
        }
        infos[i] =
            (pliant_option_info){o->group, o->name, kinds[o->kind], value, range, o->unit, o->text, o->low, o->high};
    }
}

const pliant_option_info *pliant_scene_options(size_t *count)
{
    pthread_once(&described, describe);
    *count = NUM_OPTIONS;
    return infos;
}

const pliant_option *pliant_option_table(size_t *count)
{
    *count = NUM_OPTIONS;
    return table;
}

const pliant_option *pliant_option_find(const char *path)
{
    for (int i = 0; i < NUM_OPTIONS; ++i) {
        size_t group = strlen(table[i].group);
        if (strncmp(path, table[i].group, group) == 0 && path[group] == '/' &&
            strcmp(path + group + 1, table[i].name) == 0)
            return &table[i];
    }
    return NULL;
}

static const char *range_of(const pliant_option *option)
{
    size_t count;
    return pliant_scene_options(&count)[option - table].range;
}

/* Write "'2.5' is not a whole number in 1 .. 8 cells" to reason. */
static const char *not_in_range(const pliant_option *option, const char *word, char *reason, size_t size)
{
    bool integer = option->kind == PLIANT_OPTION_INT || option->kind == PLIANT_OPTION_INT3;
    if (option->kind == PLIANT_OPTION_LENGTH)
        snprintf(reason, size, "'%.80s' is neither in %g .. %g %s nor auto", word, option->low, option->high,
                 option->unit);
    else
        snprintf(reason, size, "'%.80s' is not %s%s%s%s", word, integer ? "a whole number in " : "in ",
                 range_of(option), option->unit[0] ? " " : "", option->unit);
    return reason;
}

/* Return the size of the option's value in bytes. */
static size_t size_of(const pliant_option *option)
{
    switch (option->kind) {
    case PLIANT_OPTION_BOOL: return sizeof(bool);
    case PLIANT_OPTION_INT: return sizeof(int32_t);
    case PLIANT_OPTION_INT3: return 3 * sizeof(int32_t);
    case PLIANT_OPTION_REAL:
    case PLIANT_OPTION_LENGTH: return sizeof(double);
    case PLIANT_OPTION_REAL3: return 3 * sizeof(double);
    case PLIANT_OPTION_STRING: return sizeof((pliant_scene *)NULL)->scan.series;
    case PLIANT_OPTION_CHOICE: return sizeof(int);
    }
    return 0;
}

/* Read one word to component k of the option's value at `place`. */
static const char *read_word(const pliant_option *option, const char *word, int k, void *place, char *reason,
                             size_t size)
{
    int64_t whole;
    bool good = false;
    switch (option->kind) {
    case PLIANT_OPTION_BOOL: good = pliant_parse_bool(word, place); break;
    case PLIANT_OPTION_INT:
    case PLIANT_OPTION_INT3:
        good = pliant_parse_integer(word, &whole) && whole >= (int64_t)option->low && whole <= (int64_t)option->high;
        if (good) ((int32_t *)place)[k] = (int32_t)whole;
        break;
    case PLIANT_OPTION_REAL:
    case PLIANT_OPTION_REAL3: good = pliant_parse_real(word, (double *)place + k); break;
    case PLIANT_OPTION_LENGTH:
        good = strcmp(word, "auto") == 0;
        if (good) *(double *)place = PLIANT_AUTO_LENGTH;
        else good = pliant_parse_real(word, place) && *(double *)place != PLIANT_AUTO_LENGTH;
        break;
    case PLIANT_OPTION_STRING:
        good = strlen(word) < size_of(option);
        if (!good) {
            snprintf(reason, size, "longer than %zu characters", size_of(option) - 1);
            return reason;
        }
        memset(place, 0, size_of(option));
        memcpy(place, word, strlen(word));
        break;
    case PLIANT_OPTION_CHOICE:
        for (int n = 0; option->names[n]; ++n)
            if (strcmp(word, option->names[n]) == 0) {
                *(int *)place = n;
                good = true;
            }
        break;
    }
    if (good) return NULL;
    return not_in_range(option, word, reason, size);
}

/* Write "'7' is 1 value; use three whole numbers in 1 .. 256 cells, as [7, 7, 7]" to reason. */
static const char *describe_wrong_count(const pliant_option *option, const char *const *words, int number, char *reason,
                                        size_t size)
{
    char given[TEXT_SIZE] = "";
    const bool integer = option->kind == PLIANT_OPTION_INT3;
    for (int k = 0; k < number && k < 3; ++k)
        snprintf(given + strlen(given), sizeof given - strlen(given), "%s%.32s", k ? " " : "", words[k]);
    snprintf(reason, size, "'%s%s' is %d value%s; use %s%s in %s%s%s%s", given, number > 3 ? " ..." : "", number,
             number == 1 ? "" : "s", words_of(option) == 1 ? "one" : "three",
             integer                 ? " whole numbers"
             : words_of(option) == 1 ? " value"
                                     : " numbers",
             range_of(option), option->unit[0] ? " " : "", option->unit,
             words_of(option) == 1 ? ""
             : integer             ? ", as [7, 7, 7]"
                                   : ", as [0, 0, 1]");
    return reason;
}

const char *pliant_option_read(const pliant_option *option, const char *const *words, int number, pliant_scene *scene,
                               char *reason, size_t size)
{
    /* work on a copy, so that an error in a later word changes nothing */
    pliant_scene trial = *scene;
    if (number != words_of(option)) return describe_wrong_count(option, words, number, reason, size);
    for (int k = 0; k < number; ++k)
        if (read_word(option, words[k], k, (char *)&trial + option->offset, reason, size)) return reason;
    if (pliant_option_check(option, &trial, reason, size)) return reason;
    memcpy((char *)scene + option->offset, (char *)&trial + option->offset, size_of(option));
    return NULL;
}

const char *pliant_option_check(const pliant_option *option, const pliant_scene *scene, char *reason, size_t size)
{
    const void *place = (const char *)scene + option->offset;
    double value = 0;
    switch (option->kind) {
    case PLIANT_OPTION_BOOL: return NULL;
    case PLIANT_OPTION_STRING:
        if (memchr(place, 0, size_of(option))) return NULL;
        snprintf(reason, size, "has no end");
        return reason;
    case PLIANT_OPTION_CHOICE:
        for (int n = 0; option->names[n]; ++n)
            if (n == *(const int *)place) return NULL;
        snprintf(reason, size, "%d is not one of %s", *(const int *)place, range_of(option));
        return reason;
    default:
        for (int k = 0; k < words_of(option); ++k) {
            bool integer = option->kind == PLIANT_OPTION_INT || option->kind == PLIANT_OPTION_INT3;
            value = integer ? ((const int32_t *)place)[k] : ((const double *)place)[k];
            if (!(value >= option->low && value <= option->high) && !is_auto(option, value)) {
                char word[32];
                snprintf(word, sizeof word, "%g", value);
                return not_in_range(option, word, reason, size);
            }
        }
        return NULL;
    }
}

void pliant_option_set_default(const pliant_option *option, pliant_scene *scene)
{
    void *place = (char *)scene + option->offset;
    for (int k = 0; k < words_of(option); ++k) switch (option->kind) {
        case PLIANT_OPTION_BOOL: *(bool *)place = option->value != 0.0; break;
        case PLIANT_OPTION_INT:
        case PLIANT_OPTION_INT3: ((int32_t *)place)[k] = (int32_t)option->value; break;
        case PLIANT_OPTION_REAL:
        case PLIANT_OPTION_LENGTH:
        case PLIANT_OPTION_REAL3: ((double *)place)[k] = option->value; break;
        case PLIANT_OPTION_STRING: strcpy(place, option->string_value); break;
        case PLIANT_OPTION_CHOICE: *(int *)place = (int)option->value; break;
        }
}
