#include "rviz/shaders.h"

namespace pliant_rviz {

const char *const volume_vertex_shader = R"(#version 120
uniform mat4 worldviewproj;
varying vec3 local;
void main()
{
    local = gl_Vertex.xyz;
    gl_Position = worldviewproj * gl_Vertex;
}
)";

// Texel coordinate = local * scale + offset. window: table position = texel * x + y; everything up to table position z
// is invisible. step_i: one texel in texture coordinates; spacing: in metres, negative where the texture's axis is
// flipped.
const char *const slice_fragment_shader = R"(#version 120
uniform sampler3D volume;
uniform sampler3D table;
uniform vec3 scale, offset, step_i, spacing;
uniform vec4 window;
uniform vec4 eye;
uniform vec3 away_low, away_high;
uniform float shading, slice_spacing;
varying vec3 local;

float texel(vec3 at) { return texture3D(volume, at).r; }

void main()
{
    if (all(greaterThan(local, away_low)) && all(lessThan(local, away_high))) discard;
    vec3 towards = eye.w > 0.5 ? normalize(eye.xyz - local) : -eye.xyz;
    /* A random offset per ray turns stripes between slices into fine noise. */
    float grain = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    vec3 at = (local + towards * ((grain - 0.5) * slice_spacing)) * scale + offset;
    float place = clamp(texel(at) * window.x + window.y, 0.0, 1.0);
    /* transparent below: the many empty ones end here */
    if (place <= window.z) discard;
    vec4 colour = texture3D(table, vec3(place * (511.0 / 512.0) + 0.5 / 512.0, 0.5, 0.5));
    if (colour.a < 0.0005) discard;
    if (shading > 0.0) {
        /* from four corners of a cube of two voxels: a tetrahedron has the fewest corners that give a gradient */
        float a = texel(at + step_i), b = texel(at + vec3(step_i.x, -step_i.y, -step_i.z));
        float c = texel(at + vec3(-step_i.x, step_i.y, -step_i.z));
        float d = texel(at + vec3(-step_i.x, -step_i.y, step_i.z));
        vec3 gradient = 0.5 * vec3(a + b - c - d, a - b + c - d, a - b - c + d) / spacing;
        float steepness = length(gradient);
        /* an even region has no surface to shade */
        float surface = shading * clamp(steepness * abs(spacing.x) * window.x * 4.0, 0.0, 1.0);
        float light = abs(dot(gradient, towards)) / max(steepness, 1e-12);
        float shine = pow(light, 24.0) * 0.25 * surface;
        colour.rgb = colour.rgb * mix(1.0, 0.35 + 0.75 * light, surface) + colour.a * shine;
    }
    /* the picture has 8 bits: a faint slice would be rounded away, so it is rounded up now and then */
    float chance = fract(grain + dot(at, vec3(97.3, 71.9, 83.7)));
    gl_FragColor = colour + (chance - 0.5) / 255.0;
}
)";

const char *const surface_fragment_shader = R"(#version 120
uniform sampler3D volume;
uniform sampler3D table;
uniform mat4 worldviewproj;
uniform vec3 scale, offset, step_i, spacing;
uniform vec4 window;
uniform vec4 eye;
uniform vec3 low, high, away_low, away_high;
uniform vec4 plane;
uniform vec4 colour;
uniform float threshold, stride, steps, nearest, direction_of_values;
varying vec3 local;

/* above the threshold: positive; the texture may run against the values */
float above(vec3 at) { return (texture3D(volume, at * scale + offset).r - threshold) * direction_of_values; }

/* light on the surface, from the eight corners of a cube of two voxels: smoother than the six middles of its faces */
float light_at(vec3 point, vec3 ahead)
{
    vec3 gradient = vec3(0.0);
    for (int n = 0; n < 8; n++) {
        vec3 corner = vec3(mod(float(n), 2.0), mod(floor(float(n) / 2.0), 2.0), floor(float(n) / 4.0)) * 2.0 - 1.0;
        gradient += above(point + corner * spacing) * corner;
    }
    gradient /= spacing;
    return clamp(abs(dot(gradient, ahead)) / max(length(gradient), 1e-12), 0.0, 1.0);
}

void main()
{
    vec3 ahead = eye.w > 0.5 ? normalize(local - eye.xyz) : eye.xyz;
    vec3 origin = eye.w > 0.5 ? eye.xyz : local - ahead * dot(high - low, abs(ahead));
    vec3 rate = ahead + vec3(equal(ahead, vec3(0.0))) * 1e-9;
    vec3 a = (low - origin) / rate, b = (high - origin) / rate;
    vec3 first = min(a, b), last = max(a, b);
    float enter = max(max(first.x, first.y), max(first.z, eye.w > 0.5 ? nearest : -1e30));
    float leave = min(min(last.x, last.y), last.z);
    float side = dot(plane.xyz, origin) - plane.w, slope = dot(plane.xyz, ahead);
    if (slope > 0.0) enter = max(enter, -side / slope);
    else if (slope < 0.0) leave = min(leave, -side / slope);
    else if (side < 0.0) discard;
    if (enter > leave) discard;

    /* the removed region: from hole to end */
    vec3 c = (away_low - origin) / rate, d = (away_high - origin) / rate;
    first = min(c, d);
    last = max(c, d);
    float hole = max(max(first.x, first.y), first.z), end = min(min(last.x, last.y), last.z);
    if (hole >= end) hole = end = 1e30;
    if (enter >= hole && enter < end) enter = end;
    if (enter > leave) discard;

    float t = enter, before = enter;
    bool cut = above(origin + ahead * t) >= 0.0, met = cut;
    if (!met) {
        for (float n = 0.0; n < steps; n += 1.0) {
            if (met || before >= leave) break;
            t = min(before + stride, leave);
            if (before < hole) t = min(t, hole);
            if (above(origin + ahead * t) >= 0.0) met = true;
            else before = t;
            if (!met && before >= hole && before < end) {
                before = t = end;
                met = cut = end < leave && above(origin + ahead * end) >= 0.0;
            }
        }
    }
    if (!met) discard;
    if (!cut) {
        for (int n = 0; n < 6; n++) {
            float middle = 0.5 * (before + t);
            if (above(origin + ahead * middle) >= 0.0) t = middle;
            else before = middle;
        }
    }
    vec3 point = origin + ahead * t;
    vec3 at = point * scale + offset;
    if (cut) {
        /* a cut face shows the values themselves, grey over the window */
        float place = clamp(texture3D(volume, at).r * window.x + window.y, 0.0, 1.0);
        gl_FragColor = vec4(vec3(0.08 + 0.9 * place), 1.0);
    } else {
        float light = light_at(point, ahead);
        gl_FragColor = vec4(colour.rgb * (0.2 + 0.75 * light) + vec3(0.18 * pow(light, 32.0)), 1.0);
    }
    vec4 clip = worldviewproj * vec4(point, 1.0);
    gl_FragDepth = clamp(0.5 * clip.z / clip.w + 0.5, 0.0, 1.0);
}
)";

// normals face the viewer on both sides; colours come from the vertices
const char *const mesh_vertex_shader = R"(#version 120
uniform mat4 worldviewproj;
uniform mat4 worldview;
varying vec3 seen, normal;
varying vec4 colour;
void main()
{
    seen = (worldview * gl_Vertex).xyz;
    normal = mat3(worldview[0].xyz, worldview[1].xyz, worldview[2].xyz) * gl_Normal;
    colour = gl_Color;
    gl_Position = worldviewproj * gl_Vertex;
}
)";

const char *const mesh_fragment_shader = R"(#version 120
uniform float opacity, lit, orthographic;
varying vec3 seen, normal;
varying vec4 colour;
void main()
{
    vec3 towards = orthographic > 0.5 ? vec3(0.0, 0.0, 1.0) : normalize(-seen);
    float light = abs(dot(normalize(normal), towards));
    gl_FragColor = vec4(colour.rgb * mix(1.0, 0.3 + 0.7 * light, lit), opacity);
}
)";

} // namespace pliant_rviz
