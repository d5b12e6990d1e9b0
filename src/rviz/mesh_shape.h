// Triangles and lines of the tetrahedral mesh for rviz: checks topologies, and matches states with them. No Ogre, no
// ROS.
#ifndef PLIANT_RVIZ_MESH_SHAPE_H
#define PLIANT_RVIZ_MESH_SHAPE_H

#include "rviz/slices.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace pliant_rviz {

// Same as the message MeshTopology.
struct Topology {
    std::string scan_id;
    uint32_t revision = 0;
    std::vector<float> rest;            // x y z of every node [m]
    std::vector<uint32_t> rest_parent;  // node from which each node was copied
    std::vector<uint32_t> tetrahedra;   // four nodes each
    std::vector<uint32_t> triangles;    // three indices each, outwards: nodes, then additional vertices of the surface
    uint32_t first_cut = 0;             // index of the first triangle that is a face of a cut
    std::vector<uint16_t> material;     // material of each tetrahedron; may be empty
    std::vector<uint32_t> vertex_tetrahedron; // for the additional vertices: tetrahedron that each moves with,
    std::vector<float> vertex_weight;         // four weights of its nodes,
    std::vector<uint16_t> vertex_material;    // and material at the vertex
};

// Return "" or an error message.
std::string check(const Topology &topology);

// Vertices and triangles to draw.
struct Shape {
    std::vector<float> vertices, normals;     // x y z of each vertex
    std::vector<uint32_t> nodes;              // node of each vertex; larger numbers: additional vertices of the surface
    // material of each vertex, from the tetrahedron behind the surface; 0: none
    std::vector<uint16_t> material;
    std::vector<uint32_t> triangles, edges;   // three and two vertices each
};

class MeshShape {
public:
    // Set a topology that passed check(). If the scan is the same, nodes keep the last positions of their parents.
    void start(Topology topology);
    void clear() { *this = MeshShape(); }
    bool empty() const { return topology_.rest.empty(); }

    enum Result { SHOWN, NO_TOPOLOGY, OTHER_REVISION, WRONG_SIZE, NOT_FINITE };
    // Set a state; only the result SHOWN changes anything.
    Result put(uint32_t revision, const std::vector<float> &nodes, const std::vector<float> &scalar);

    const Topology &topology() const { return topology_; }
    const std::vector<float> &nodes() const { return nodes_; }
    const std::vector<float> &scalar() const { return scalar_; } // value of each node; may be empty
    float scalar_of(uint32_t node) const;                        // value of a node or an additional vertex
    // Return the range of the finite values; false: no finite value.
    bool scalar_range(float *low, float *high) const;

    // Return the whole surface, with normals averaged over the faces around each node. Faces of cuts have separate
    // vertices, so that their rim is sharp. Edges: mesh edges and the rim.
    Shape surface() const;
    // Return the outer faces of all tetrahedra whose centre lies on the kept side of the plane, with one normal per
    // face.
    Shape cut(const Plane &plane) const;

private:
    struct Face {
        std::array<uint32_t, 3> nodes; // outwards, as seen from the inner tetrahedron
        int32_t inner, outer;          // tetrahedra on both sides; outer -1: none
    };
    void find_faces();
    void find_edges(Shape *shape) const;
    float at_vertex(uint32_t vertex, const std::vector<float> &nodes, size_t each, size_t which) const;

    Topology topology_;
    std::vector<float> nodes_, scalar_;
    std::vector<Face> faces_;
};

// Return the unit of a scalar of MeshState; "": no unit.
const char *scalar_unit(const std::string &name);

// Return the distance of each node from its rest position [m].
std::vector<float> displacements(const std::vector<float> &rest, const std::vector<float> &nodes);

// Red, green, blue in 0..1.
using Rgb = std::array<double, 3>;
Rgb sequential_colour(double t);           // from dark blue to red
Rgb diverging_colour(double t);            // blue, white in the middle, red
Rgb material_colour(uint16_t material);    // consecutive numbers have distinct colours

} // namespace pliant_rviz
#endif
