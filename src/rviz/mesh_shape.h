// The tetrahedral mesh as rviz draws it: checked, matched with its states, turned into triangles and lines. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_MESH_SHAPE_H
#define PLIANT_RVIZ_MESH_SHAPE_H

#include "rviz/slices.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace pliant_rviz {

// As in MeshTopology.
struct Topology {
    std::string scan_id;
    uint32_t revision = 0;
    std::vector<float> rest;            // x y z of every node [m]
    std::vector<uint32_t> rest_parent;  // node that a node was split from
    std::vector<uint32_t> tetrahedra;   // four nodes each
    std::vector<uint32_t> triangles;    // three each, outwards: nodes, and after them vertices of the surface's own
    uint32_t first_cut = 0;             // triangle from which on they are faces of cuts
    std::vector<uint16_t> material;     // of each tetrahedron, or none
    std::vector<uint32_t> vertex_tetrahedron; // of the surface's own vertices: what each moves with,
    std::vector<float> vertex_weight;         // four each, of its nodes,
    std::vector<uint16_t> vertex_material;    // and the scan there
};

// "" or what is wrong with it.
std::string check(const Topology &topology);

// What to draw: vertex by vertex.
struct Shape {
    std::vector<float> vertices, normals;     // x y z
    std::vector<uint32_t> nodes;              // node of each vertex, or, after those, of the surface's own
    std::vector<uint16_t> material;           // of each vertex: of the tetrahedron in front; 0 where there is none
    std::vector<uint32_t> triangles, edges;   // three, two vertices each
};

class MeshShape {
public:
    // Takes over a topology that passed check(). Nodes stay where their parents were last seen if the scan is the same.
    void start(Topology topology);
    void clear() { *this = MeshShape(); }
    bool empty() const { return topology_.rest.empty(); }

    enum Result { SHOWN, NO_TOPOLOGY, OTHER_REVISION, WRONG_SIZE, NOT_FINITE };
    // A state; anything but SHOWN leaves everything as it was.
    Result put(uint32_t revision, const std::vector<float> &nodes, const std::vector<float> &scalar);

    const Topology &topology() const { return topology_; }
    const std::vector<float> &nodes() const { return nodes_; }
    const std::vector<float> &scalar() const { return scalar_; } // of each node, or none
    float scalar_of(uint32_t node) const;                        // of a node or, after those, of the surface's own vertices
    bool scalar_range(float *low, float *high) const;            // of the finite ones; false: there are none

    // The whole surface, with normals that are the mean of the faces around a node; faces of cuts have vertices of their own, so that their
    // rim is sharp. Edges: those of the mesh, and the rim.
    Shape surface() const;
    // The tetrahedra whose middle lies on the kept side of the plane: their outer faces, one normal a face.
    Shape cut(const Plane &plane) const;

private:
    struct Face {
        std::array<uint32_t, 3> nodes; // outwards, seen from the inner tetrahedron
        int32_t inner, outer;          // tetrahedra; outer -1: none
    };
    void find_faces();
    void find_edges(Shape *shape) const;
    float at_vertex(uint32_t vertex, const std::vector<float> &nodes, size_t each, size_t which) const;

    Topology topology_;
    std::vector<float> nodes_, scalar_;
    std::vector<Face> faces_;
};

// Unit of a number of MeshState, by its name; "": it has none.
const char *scalar_unit(const std::string &name);

// How far each node is from where it was at rest [m].
std::vector<float> displacements(const std::vector<float> &rest, const std::vector<float> &nodes);

// Red, green, blue in 0..1.
using Rgb = std::array<double, 3>;
Rgb sequential_colour(double t);           // from dark blue to red
Rgb diverging_colour(double t);            // blue, white in the middle, red
Rgb material_colour(uint16_t material);    // neighbours in number look different

} // namespace pliant_rviz
#endif
