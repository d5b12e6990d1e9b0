#include "rviz/mesh_shape.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <tuple>

namespace pliant_rviz {

namespace {

// outward faces of a tetrahedron with det(x1 - x0, x2 - x0, x3 - x0) > 0
const int FACES[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

std::string check_nodes(const std::vector<uint32_t> &list, size_t nodes, size_t each, const char *name)
{
    std::ostringstream out;
    if (list.size() % each != 0) out << name << " has " << list.size() << " numbers, not a multiple of " << each;
    for (size_t n = 0; n < list.size() && out.tellp() == 0; n++)
        if (list[n] >= nodes) out << name << "[" << n << "] is node " << list[n] << ", but there are " << nodes;
    return out.str();
}

bool finite(const std::vector<float> &numbers)
{
    return std::all_of(numbers.begin(), numbers.end(), [](float x) { return std::isfinite(x); });
}

Vector at(const std::vector<float> &nodes, uint32_t node)
{
    return {{nodes[3 * node], nodes[3 * node + 1], nodes[3 * node + 2]}};
}

// twice the area times the outward unit normal
Vector normal_of(const Vector &a, const Vector &b, const Vector &c)
{
    Vector u, v;
    for (int d = 0; d < 3; d++) {
        u[d] = b[d] - a[d];
        v[d] = c[d] - a[d];
    }
    return {{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]}};
}

void normalise(float *v)
{
    float length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int d = 0; d < 3; d++) v[d] = length > 0 ? v[d] / length : d == 2;
}

Rgb between(const std::vector<Rgb> &colours, double t)
{
    double along = std::min(std::max(t, 0.0), 1.0) * double(colours.size() - 1);
    size_t n = std::min(size_t(along), colours.size() - 2);
    Rgb out;
    for (size_t c = 0; c < 3; c++) out[c] = colours[n][c] + (along - double(n)) * (colours[n + 1][c] - colours[n][c]);
    return out;
}

} // namespace

std::string check(const Topology &topology)
{
    if (topology.rest.empty() || topology.rest.size() % 3 != 0) {
        std::ostringstream out;
        out << "rest_nodes has " << topology.rest.size() << " numbers, not three a node";
        return out.str();
    }
    size_t nodes = topology.rest.size() / 3;
    if (!finite(topology.rest)) return "rest_nodes holds NaN or infinite numbers";
    std::string error = check_nodes(topology.tetrahedra, nodes, 4, "tetrahedra");
    const size_t vertices = topology.vertex_tetrahedron.size();
    if (error.empty()) error = check_nodes(topology.triangles, nodes + vertices, 3, "triangles");
    if (error.empty()) error = check_nodes(topology.rest_parent, nodes, 1, "rest_parent");
    if (!error.empty()) return error;
    if (!topology.rest_parent.empty() && topology.rest_parent.size() != nodes)
        return "rest_parent must have one number a node";
    if (!topology.material.empty() && topology.material.size() != topology.tetrahedra.size() / 4)
        return "material must have one number a tetrahedron";
    for (uint32_t tet : topology.vertex_tetrahedron)
        if (tet >= topology.tetrahedra.size() / 4) return "vertex_tetrahedron names a tetrahedron that is not there";
    if (topology.vertex_weight.size() != 4 * vertices || !finite(topology.vertex_weight))
        return "vertex_weight must have four numbers a vertex";
    if (topology.vertex_material.size() != vertices) return "vertex_material must have one number a vertex";
    return "";
}

void MeshShape::start(Topology topology)
{
    size_t nodes = topology.rest.size() / 3, seen = nodes_.size() / 3;
    bool same_scan = seen > 0 && topology.scan_id == topology_.scan_id && topology.rest_parent.size() == nodes &&
                     topology_.rest_parent.size() == seen;
    std::vector<float> now = topology.rest, scalar(scalar_.empty() ? 0 : nodes);
    for (size_t n = 0; same_scan && n < nodes; n++) {
        // a node that existed before, otherwise the node from which it was copied
        bool was_there = n < seen && topology_.rest_parent[n] == topology.rest_parent[n];
        size_t source = was_there ? n : topology.rest_parent[n];
        same_scan = source < seen;
        if (!same_scan) break;
        std::copy_n(&nodes_[3 * source], 3, &now[3 * n]);
        if (!scalar.empty()) scalar[n] = scalar_[source];
    }
    nodes_ = same_scan ? std::move(now) : topology.rest;
    scalar_ = same_scan ? std::move(scalar) : std::vector<float>();
    topology_ = std::move(topology);
    find_faces();
}

MeshShape::Result MeshShape::put(uint32_t revision, const std::vector<float> &nodes, const std::vector<float> &scalar)
{
    if (empty()) return NO_TOPOLOGY;
    if (revision != topology_.revision) return OTHER_REVISION;
    if (nodes.size() != topology_.rest.size() || (!scalar.empty() && scalar.size() != nodes.size() / 3))
        return WRONG_SIZE;
    if (!finite(nodes)) return NOT_FINITE;
    nodes_ = nodes;
    scalar_ = scalar;
    return SHOWN;
}

// Interpolate node values, `each` of them per node, at an additional vertex of the surface.
float MeshShape::at_vertex(uint32_t vertex, const std::vector<float> &nodes, size_t each, size_t which) const
{
    float sum = 0;
    for (size_t v = 0; v < 4; v++) {
        const size_t node = topology_.tetrahedra[4 * size_t(topology_.vertex_tetrahedron[vertex]) + v];
        sum += topology_.vertex_weight[4 * size_t(vertex) + v] * nodes[each * node + which];
    }
    return sum;
}

float MeshShape::scalar_of(uint32_t node) const
{
    const size_t nodes = nodes_.size() / 3;
    return node < nodes ? scalar_[node] : at_vertex(node - uint32_t(nodes), scalar_, 1, 0);
}

bool MeshShape::scalar_range(float *low, float *high) const
{
    float minimum = std::numeric_limits<float>::max(), maximum = std::numeric_limits<float>::lowest();
    for (float x : scalar_)
        if (std::isfinite(x)) {
            minimum = std::min(minimum, x);
            maximum = std::max(maximum, x);
        }
    if (minimum > maximum) return false;
    *low = minimum;
    *high = maximum;
    return true;
}

void MeshShape::find_faces()
{
    struct Key {
        std::array<uint32_t, 3> sorted, given;
        int32_t tet;
    };
    std::vector<Key> all;
    const std::vector<uint32_t> &tets = topology_.tetrahedra;
    all.reserve(tets.size());
    for (size_t t = 0; t < tets.size() / 4; t++)
        for (const int *face : FACES) {
            Key key;
            for (int v = 0; v < 3; v++) key.given[size_t(v)] = tets[4 * t + size_t(face[v])];
            key.sorted = key.given;
            std::sort(key.sorted.begin(), key.sorted.end());
            key.tet = int32_t(t);
            all.push_back(key);
        }
    std::sort(all.begin(), all.end(),
              [](const Key &a, const Key &b) { return a.sorted != b.sorted ? a.sorted < b.sorted : a.tet < b.tet; });
    faces_.clear();
    for (size_t n = 0; n < all.size(); n++) {
        bool shared = n + 1 < all.size() && all[n + 1].sorted == all[n].sorted;
        faces_.push_back({all[n].given, all[n].tet, shared ? all[n + 1].tet : -1});
        if (shared) n++;
    }
}

void MeshShape::find_edges(Shape *shape) const
{
    struct Edge {
        uint32_t low, high, vertex[2];
        bool cut;
        bool operator<(const Edge &other) const
        {
            return std::tie(low, high, cut) < std::tie(other.low, other.high, other.cut);
        }
        bool same(const Edge &other) const { return low == other.low && high == other.high; }
    };
    const size_t cut = 3 * size_t(topology_.first_cut), nodes = nodes_.size() / 3;
    std::vector<Edge> edges;
    for (size_t n = 0; n < shape->triangles.size(); n += 3)
        for (size_t v = 0; v < 3; v++) {
            const uint32_t a = shape->triangles[n + v], b = shape->triangles[n + (v + 1) % 3];
            const uint32_t node_a = shape->nodes[a], node_b = shape->nodes[b];
            edges.push_back({std::min(node_a, node_b), std::max(node_a, node_b), {a, b}, cut > 0 && n >= cut});
        }
    std::stable_sort(edges.begin(), edges.end());
    for (size_t n = 0, end; n < edges.size(); n = end) {
        for (end = n; end < edges.size() && edges[end].same(edges[n]);) end++;
        const bool rim = !edges[n].cut && edges[end - 1].cut;
        if (edges[n].high < nodes || rim)
            shape->edges.insert(shape->edges.end(), {edges[n].vertex[0], edges[n].vertex[1]});
    }
}

Shape MeshShape::surface() const
{
    Shape shape;
    const size_t nodes = nodes_.size() / 3, all = nodes + topology_.vertex_tetrahedron.size(),
                 cut = 3 * size_t(topology_.first_cut);
    const uint32_t none = 0xffffffff;
    std::vector<uint32_t> vertex(2 * all, none); // outer triangles, then faces of cuts
    for (size_t n = 0; n < topology_.triangles.size(); n++) {
        const uint32_t node = topology_.triangles[n];
        uint32_t &place = vertex[node + (cut > 0 && n >= cut ? all : 0)];
        if (place == none) {
            place = uint32_t(shape.nodes.size());
            shape.nodes.push_back(node);
            shape.material.push_back(node < nodes ? uint16_t(0) : topology_.vertex_material[node - nodes]);
            for (size_t d = 0; d < 3; d++)
                shape.vertices.push_back(node < nodes ? nodes_[3 * node + d]
                                                      : at_vertex(node - uint32_t(nodes), nodes_, 3, d));
        }
        shape.triangles.push_back(place);
    }
    shape.normals.assign(shape.vertices.size(), 0);
    if (!topology_.material.empty())
        for (const Face &face : faces_)
            if (face.outer < 0)
                for (uint32_t node : face.nodes)
                    for (uint32_t place : {vertex[node], vertex[node + all]})
                        if (place != none) shape.material[place] = topology_.material[size_t(face.inner)];
    for (size_t n = 0; n < shape.triangles.size(); n += 3) {
        const uint32_t *corner = &shape.triangles[n];
        Vector normal =
            normal_of(at(shape.vertices, corner[0]), at(shape.vertices, corner[1]), at(shape.vertices, corner[2]));
        for (size_t v = 0; v < 3; v++)
            for (size_t d = 0; d < 3; d++) shape.normals[3 * corner[v] + d] += float(normal[d]);
    }
    for (size_t n = 0; n < shape.normals.size(); n += 3) normalise(&shape.normals[n]);
    find_edges(&shape);
    return shape;
}

Shape MeshShape::cut(const Plane &plane) const
{
    const std::vector<uint32_t> &tets = topology_.tetrahedra;
    std::vector<bool> kept(tets.size() / 4);
    for (size_t t = 0; t < kept.size(); t++) {
        double side = 0;
        for (size_t v = 0; v < 4; v++) side += dot(plane.normal, at(nodes_, tets[4 * t + v]));
        kept[t] = 0.25 * side >= plane.offset;
    }
    Shape shape;
    for (const Face &face : faces_) {
        bool inner = kept[size_t(face.inner)], outer = face.outer >= 0 && kept[size_t(face.outer)];
        if (inner == outer) continue;
        std::array<uint32_t, 3> nodes = face.nodes;
        if (outer) std::swap(nodes[1], nodes[2]);
        Vector normal = normal_of(at(nodes_, nodes[0]), at(nodes_, nodes[1]), at(nodes_, nodes[2]));
        float unit[3] = {float(normal[0]), float(normal[1]), float(normal[2])};
        normalise(unit);
        size_t tet = size_t(inner ? face.inner : face.outer);
        for (uint32_t node : nodes) {
            shape.triangles.push_back(uint32_t(shape.nodes.size()));
            shape.nodes.push_back(node);
            shape.material.push_back(topology_.material.empty() ? uint16_t(0) : topology_.material[tet]);
            shape.vertices.insert(shape.vertices.end(), {nodes_[3 * node], nodes_[3 * node + 1], nodes_[3 * node + 2]});
            shape.normals.insert(shape.normals.end(), unit, unit + 3);
        }
    }
    find_edges(&shape);
    return shape;
}

const char *scalar_unit(const std::string &name)
{
    static const char *const units[][2] = {
        {"von_mises", "Pa"},        {"principal_stress", "Pa"}, {"strain_energy", "J/m\u00b3"},
        {"mass_change", "m\u00b3"}, {"contact_force", "N"},     {"displacement", "m"}};
    for (const auto &each : units)
        if (name == each[0]) return each[1];
    return "";
}

std::vector<float> displacements(const std::vector<float> &rest, const std::vector<float> &nodes)
{
    std::vector<float> out(nodes.size() / 3);
    for (size_t n = 0; n < out.size() && 3 * n + 2 < rest.size(); n++) {
        double sum = 0;
        for (size_t d = 3 * n; d < 3 * n + 3; d++) sum += std::pow(double(nodes[d]) - rest[d], 2);
        out[n] = float(std::sqrt(sum));
    }
    return out;
}

Rgb sequential_colour(double t)
{
    static const std::vector<Rgb> colours = {
        {{0.10, 0.12, 0.42}}, {{0.10, 0.45, 0.65}}, {{0.25, 0.70, 0.50}}, {{0.92, 0.84, 0.25}}, {{0.84, 0.16, 0.10}}};
    return between(colours, t);
}

Rgb diverging_colour(double t)
{
    static const std::vector<Rgb> colours = {{{0.12, 0.25, 0.70}}, {{0.92, 0.92, 0.92}}, {{0.75, 0.10, 0.12}}};
    return between(colours, t);
}

Rgb material_colour(uint16_t material)
{
    // hues differ by the golden angle
    double hue = std::fmod(0.08 + 0.6180339887 * material, 1.0) * 6;
    Rgb out;
    const double shift[3] = {0, 4, 2};
    for (size_t c = 0; c < 3; c++) {
        double x = std::fabs(std::fmod(hue + shift[c], 6.0) - 3) - 1;
        out[c] = 0.35 + 0.55 * std::min(std::max(x, 0.0), 1.0);
    }
    return out;
}

} // namespace pliant_rviz
