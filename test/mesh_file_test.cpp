// Tests of meshes from other programs as the fine mesh: .vtu and .msh files, their regions, and refused files.
#include "pipeline/body.h"
#include "scan_files.h"

#include "base/fail.h"
#include "mesh/mesh.h"
#include "mesh/mesh_file.h"

#include <array>
#include <fstream>
#include <map>
#include <random>
#include <sstream>
#include <tuple>
#include <zlib.h>

namespace {

// A block of soft material (label 0) with a layer of stiff material (label 1) at x = 0. It has 8 x 4 x 4 cubes of 1 cm.
struct Block : Body {
    Block()
        : Body(size_, box_, {{5000, 0.4, 1000, false}, {20000, 0.3, 1000, false}},
               [](int i, int, int) { return i < 4; })
    {
        std::strcpy(table.materials[0].name, "soft");
        std::strcpy(table.materials[1].name, "stiff");
        fix_plane(1e-6, 0, 0, 1, 0, 0);
        cells(8, 4, 4, 1);
        scene.model.gravity[2] = -2;
    }
    static constexpr int size_[3] = {16, 8, 8};
    static constexpr double box_[3] = {0.08, 0.04, 0.04};
};
constexpr int Block::size_[3];
constexpr double Block::box_[3];

struct Tets {
    std::vector<double> nodes;
    std::vector<int32_t> tets;
    std::vector<int> region;
};

Tets tets_of(Block &block)
{
    EXPECT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    const pliant_body &body = *pliant_model_get_body(block.model);
    Tets out{{body.fine.rest, body.fine.rest + 3 * body.fine.num_nodes},
             {body.fine.tets, body.fine.tets + 4 * body.fine.num_tets},
             {}};
    for (int32_t t = 0; t < body.fine.num_tets; t++) out.region.push_back(body.fine_material[t].material);
    return out;
}

void put(std::string *out, bool binary, int64_t value, size_t bytes)
{
    if (binary) out->append(reinterpret_cast<const char *>(&value), bytes);
    else *out += std::to_string(value) + " ";
}
void put_int(std::string *out, bool binary, int64_t value) { put(out, binary, value, 4); }
void put_size(std::string *out, bool binary, int64_t value) { put(out, binary, value, 8); }
void put_real(std::string *out, bool binary, double value)
{
    char text[64];
    std::snprintf(text, sizeof text, "%.17g ", value);
    if (binary) out->append(reinterpret_cast<const char *>(&value), 8);
    else *out += text;
}

// Return a Gmsh 4.1 file in millimetres. It has two volumes with these physical groups, gaps in the node tags, and one
// triangle.
std::string msh_of(const Tets &of, bool binary, const std::array<std::string, 2> &names)
{
    std::string out = "$MeshFormat\n4.1 " + std::to_string(binary) + " 8\n";
    const auto line = [&] { out += "\n"; };
    if (binary) {
        put_int(&out, true, 1);
        line();
    }
    out += "$EndMeshFormat\n$PhysicalNames\n3\n2 9 \"wall\"\n3 5 \"" + names[0] + "\"\n3 6 \"" + names[1] +
           "\"\n$EndPhysicalNames\n$Entities\n";
    for (int count : {1, 0, 1, 2}) put_size(&out, binary, count);
    if (!binary) line();
    put_int(&out, binary, 3); // a point
    for (int d = 0; d < 3; d++) put_real(&out, binary, 0);
    put_size(&out, binary, 0);
    if (!binary) line();
    for (int entity : {7, 11, 12}) { // a surface, two volumes
        put_int(&out, binary, entity);
        for (int d = 0; d < 6; d++) put_real(&out, binary, d);
        put_size(&out, binary, 1);
        put_int(&out, binary, entity == 7 ? 9 : entity - 6);
        put_size(&out, binary, 1);
        put_int(&out, binary, 3);
        if (!binary) line();
    }
    out += "\n$EndEntities\n$Nodes\n";
    const int64_t nodes = static_cast<int64_t>(of.nodes.size() / 3), tets = static_cast<int64_t>(of.region.size());
    for (int64_t number : {int64_t(1), nodes, int64_t(10), 10 + 3 * nodes}) put_size(&out, binary, number);
    if (!binary) line();
    for (int number : {3, 11, 0}) put_int(&out, binary, number);
    put_size(&out, binary, nodes);
    if (!binary) line();
    for (int64_t n = 0; n < nodes; n++) put_size(&out, binary, 10 + 3 * (nodes - n));
    if (!binary) line();
    for (double x : of.nodes) put_real(&out, binary, 1000 * x);
    out += "\n$EndNodes\n$Elements\n";
    for (int64_t number : {int64_t(3), tets + 1, int64_t(1), tets + 1}) put_size(&out, binary, number);
    if (!binary) line();
    for (int number : {2, 7, 2}) put_int(&out, binary, number);
    put_size(&out, binary, 1);
    for (int v = 0; v < 4; v++) put_size(&out, binary, v == 0 ? 1 : 10 + 3 * v);
    int64_t tag = 2;
    for (int region = 0; region < 2; region++) {
        for (int number : {3, 11 + region, 4}) put_int(&out, binary, number);
        put_size(&out, binary, std::count(of.region.begin(), of.region.end(), region));
        for (int64_t t = 0; t < tets; t++) {
            if (of.region[static_cast<size_t>(t)] != region) continue;
            put_size(&out, binary, tag++);
            // inverted orientation
            for (int v : {0, 2, 1, 3})
                put_size(&out, binary, 10 + 3 * (nodes - of.tets[static_cast<size_t>(4 * t + v)]));
        }
    }
    return out + "\n$EndElements\n";
}

std::string base64(const std::string &in)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (size_t at = 0; at < in.size(); at += 3) {
        uint32_t all = 0;
        for (size_t b = 0; b < 3; b++) all = all << 8 | (at + b < in.size() ? static_cast<uint8_t>(in[at + b]) : 0);
        for (int d = 0; d < 4; d++)
            out += static_cast<size_t>(d) > in.size() - at ? '=' : digits[all >> (18 - 6 * d) & 63];
    }
    return out;
}

// An array as meshio writes it: base64 of zlib blocks, with a separate header.
template <class Number> std::string packed(const std::vector<Number> &numbers)
{
    const std::string plain(reinterpret_cast<const char *>(numbers.data()), numbers.size() * sizeof(Number));
    const size_t block = 1000;
    std::vector<uint32_t> header{0, block, static_cast<uint32_t>(plain.size() % block)};
    std::string blocks;
    for (size_t at = 0; at < plain.size(); at += block, header[0]++) {
        std::string made(compressBound(block), 0);
        uLongf size = made.size();
        EXPECT_EQ(compress(reinterpret_cast<Bytef *>(&made[0]), &size,
                           reinterpret_cast<const Bytef *>(plain.data()) + at, std::min(block, plain.size() - at)),
                  Z_OK);
        blocks += made.substr(0, size);
        header.push_back(static_cast<uint32_t>(size));
    }
    return base64({reinterpret_cast<const char *>(header.data()), 4 * header.size()}) + base64(blocks);
}

std::string compressed_vtu(const Tets &of, const char *region)
{
    std::vector<int64_t> corners(of.tets.begin(), of.tets.end()), ends, types(of.region.size(), 10);
    for (size_t t = 0; t < of.region.size(); t++) ends.push_back(static_cast<int64_t>(4 * (t + 1)));
    std::ostringstream out;
    const auto array = [&](const char *type, const char *name, int components, const std::string &data) {
        out << "<DataArray type=\"" << type << "\" Name=\"" << name << "\" NumberOfComponents=\"" << components
            << "\" format=\"binary\">\n"
            << data << "\n</DataArray>\n";
    };
    out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\" "
           "header_type=\"UInt32\" compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\""
        << of.nodes.size() / 3 << "\" NumberOfCells=\"" << of.region.size() << "\">\n<Points>\n";
    array("Float64", "Points", 3, packed(of.nodes));
    out << "</Points>\n<Cells>\n";
    array("Int64", "connectivity", 1, packed(corners));
    array("Int64", "offsets", 1, packed(ends));
    array("Int64", "types", 1, packed(types));
    out << "</Cells>\n<CellData>\n";
    array("Int32", region, 1, packed(of.region));
    out << "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
    return out.str();
}

std::string written(const temporary_folder &folder, const char *name, const std::string &content)
{
    const std::string path = folder / name;
    std::ofstream(path, std::ios::binary) << content;
    return path;
}

// Return the positions by rest position, in static equilibrium.
std::map<std::tuple<int, int, int>, std::vector<double>> settled(Body &body)
{
    std::map<std::tuple<int, int, int>, std::vector<double>> out;
    EXPECT_EQ(body.settle(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &mesh = pliant_data_get_body(body.data)->fine;
    const double *at = pliant_data_get_positions(body.data, nullptr);
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        const auto place = [&](int d) { return static_cast<int>(std::lround(1e6 * mesh.rest[3 * n + d])); };
        out[std::make_tuple(place(0), place(1), place(2))] = {at + 3 * n, at + 3 * n + 3};
    }
    return out;
}

void expect_same_sag(Block &lattice, Block &file)
{
    const auto wanted = settled(lattice), found = settled(file);
    ASSERT_EQ(found.size(), wanted.size());
    double difference = 0, maximum = 0;
    for (const auto &node : wanted) {
        ASSERT_TRUE(found.count(node.first));
        maximum = std::max(maximum, std::fabs(node.second[2] - 1e-6 * std::get<2>(node.first)));
        for (int d = 0; d < 3; d++)
            difference = std::max(difference, std::fabs(found.at(node.first)[d] - node.second[d]));
    }
    EXPECT_GT(maximum, 1e-3);
    EXPECT_LT(difference, 1e-6 * maximum + 1e-9);
}

void use(Block *block, const std::string &path, double unit)
{
    ASSERT_LT(path.size(), sizeof block->scene.mesh.file);
    std::strcpy(block->scene.mesh.file, path.c_str());
    block->scene.mesh.unit = unit;
}

TEST(MeshFile, SagsAsTheLatticeThatItWasSavedFrom)
{
    Block lattice;
    const Tets tets = tets_of(lattice);
    temporary_folder folder;
    const pliant_body *body = pliant_model_get_body(lattice.model);
    ASSERT_EQ(pliant_mesh_save((folder / "own.vtu").c_str(), lattice.model, body, body->fine.rest, nullptr, 1e-3),
              PLIANT_OK);
    const struct { std::string path; double unit; } files[] = {
        {folder / "own.vtu", 1e-3},
        {written(folder, "packed.vtu", compressed_vtu(tets, "material")), 1},
        {written(folder, "text.msh", msh_of(tets, false, {{"Soft", "stiff"}})), 1e-3},
        {written(folder, "binary.msh", msh_of(tets, true, {{"soft", "STIFF"}})), 1e-3}};
    for (const auto &file : files) {
        SCOPED_TRACE(file.path);
        Block block;
        use(&block, file.path, file.unit);
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        const pliant_body *made = pliant_model_get_body(block.model);
        ASSERT_EQ(made->fine.num_tets, static_cast<int32_t>(tets.region.size()));
        int32_t stiff = 0;
        for (int32_t t = 0; t < made->fine.num_tets; t++) stiff += made->fine_material[t].material == 1;
        EXPECT_EQ(stiff, std::count(tets.region.begin(), tets.region.end(), 1));
        ASSERT_EQ(pliant_data_reset(lattice.model, lattice.data), PLIANT_OK);
        expect_same_sag(lattice, block);
    }
}

TEST(MeshFile, FindsTheTetrahedronOfEveryPoint)
{
    Block lattice;
    temporary_folder folder;
    Block block;
    use(&block, written(folder, "a.msh", msh_of(tets_of(lattice), true, {{"soft", "stiff"}})), 1e-3);
    ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &mesh = pliant_model_get_body(block.model)->fine;
    std::mt19937 random(1);
    std::uniform_real_distribution<double> within(0, 1);
    for (int n = 0; n < 5000; n++) {
        const double point[3] = {0.08 * within(random), 0.04 * within(random), 0.04 * within(random)};
        double weight[4], at[3] = {0, 0, 0};
        const int32_t tet = pliant_mesh_locate(&mesh, point, weight);
        ASSERT_GE(tet, 0);
        for (int v = 0; v < 4; v++) {
            ASSERT_GE(weight[v], -1e-6);
            for (int d = 0; d < 3; d++) at[d] += weight[v] * mesh.rest[3 * mesh.tets[4 * tet + v] + d];
        }
        for (int d = 0; d < 3; d++) ASSERT_NEAR(at[d], point[d], 1e-12);
    }
    const double outside[3] = {0.09, 0.02, 0.02};
    double weight[4];
    EXPECT_EQ(pliant_mesh_locate(&mesh, outside, weight), -1);
}

TEST(MeshFile, IsPulledDrawnAndCarriedByDynamicsToo)
{
    Block lattice;
    const Tets tets = tets_of(lattice);
    temporary_folder folder;
    const std::string path = written(folder, "a.msh", msh_of(tets, true, {{"soft", "stiff"}}));
    for (pliant_solver_kind kind : {PLIANT_COROTATIONAL, PLIANT_TLED}) {
        SCOPED_TRACE(kind);
        Block block;
        use(&block, path, 1e-3);
        block.scene.solver.kind = kind;
        block.scene.element.kind = PLIANT_ELEMENT_AUTO;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_model_get_scene(block.model)->element.kind, PLIANT_LINEAR);
        ASSERT_EQ(pliant_data_set_warp(block.model, block.data, &block.scan.geometry), PLIANT_OK)
            << pliant_last_error();
        int tool = -1;
        const double point[3] = {0.078, 0.02, 0.02}, away[3] = {0.078, 0.02, 0.025};
        ASSERT_EQ(pliant_tool_add(block.model, block.data, "tool", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(block.data, tool, point, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(block.model, block.data, tool, point), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_tool_set_drive(block.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(block.data, tool, away, nullptr), PLIANT_OK);
        for (int step = 0; step < 10; step++)
            ASSERT_GE(pliant_step(block.model, block.data), PLIANT_OK) << pliant_last_error();
        pliant_tool_state state;
        ASSERT_EQ(pliant_tool_get(block.data, tool, &state), PLIANT_OK);
        EXPECT_NEAR(state.held_point[2], 0.025, 1e-4);
        EXPECT_EQ(pliant_data_get_inverted(block.data), 0);
    }
}

TEST(MeshFile, TakesMaterialsOfTheScanWithoutRegions)
{
    Block lattice;
    const Tets tets = tets_of(lattice);
    temporary_folder folder;
    Block block;
    use(&block, written(folder, "a.vtu", compressed_vtu(tets, "something else")), 1);
    ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    const pliant_body *body = pliant_model_get_body(block.model);
    for (int32_t t = 0; t < body->fine.num_tets; t++) {
        double centre = 0;
        for (int v = 0; v < 4; v++) centre += 0.25 * body->fine.rest[3 * body->fine.tets[4 * t + v]];
        ASSERT_EQ(body->fine_material[t].material, centre < 0.02) << centre;
    }
}

TEST(MeshFile, HoldsTheNodesOfFixedRegions)
{
    Block lattice;
    const Tets tets = tets_of(lattice);
    temporary_folder folder;
    Block block;
    block.table.materials[1].fixed = true;
    block.scene.fixed.num_planes = 0;
    use(&block, written(folder, "a.msh", msh_of(tets, true, {{"soft", "stiff"}})), 1e-3);
    ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    const pliant_body *body = pliant_model_get_body(block.model);
    for (int32_t n = 0; n < body->fine.num_nodes; n++)
        EXPECT_EQ(body->fine_fixed[n] != 0, body->fine.rest[3 * n] < 0.02 + 1e-6);
}

void expect_refused(const std::string &path, double unit, pliant_status status, const std::vector<std::string> &words,
                    const std::function<void(Block &)> &change = [](Block &) {})
{
    SCOPED_TRACE(words.at(0));
    Block block;
    use(&block, path, unit);
    change(block);
    EXPECT_EQ(block.build(), status);
    for (const std::string &word : words)
        EXPECT_NE(std::string(pliant_last_error()).find(word), std::string::npos) << pliant_last_error();
}

std::string replaced(std::string text, const std::string &from, const std::string &to)
{
    const size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

TEST(MeshFile, ErrorsNameProblemAndRemedy)
{
    Block lattice;
    const Tets tets = tets_of(lattice);
    temporary_folder folder;
    const std::array<std::string, 2> names{{"soft", "stiff"}}, others{{"soft", "styff"}};
    const std::string text = msh_of(tets, false, names), vtu = compressed_vtu(tets, "label");
    const auto file = [&](const char *name, const std::string &content) { return written(folder, name, content); };
    expect_refused(folder / "none.msh", 1, PLIANT_ERROR_FILE, {"none.msh"});
    expect_refused(file("a.stl", text), 1, PLIANT_ERROR_FORMAT, {"a.stl", ".vtu", ".msh"});
    expect_refused(file("a.msh", replaced(text, "4.1 0 8", "2.2 0 8")), 1e-3, PLIANT_ERROR_FORMAT, {"2.2", "msh41"});
    expect_refused(file("a.msh", text.substr(0, text.size() / 2)), 1e-3, PLIANT_ERROR_FORMAT, {"a.msh"});
    expect_refused(file("a.msh", replaced(text, "3 11 4 ", "3 11 5 ")), 1e-3, PLIANT_ERROR_FORMAT,
                   {"type 5", "-order 1"});
    expect_refused(file("a.msh", msh_of(tets, true, others)), 1e-3, PLIANT_ERROR_MATERIAL,
                   {"6 'styff' (nearest: stiff"});
    expect_refused(file("a.msh", text), 1, PLIANT_ERROR_SCENE, {"lies outside the scan", "mesh/unit"},
                   [](Block &block) {
                       for (int d = 0; d < 3; d++) block.scan.geometry.origin[d] -= 1;
                   });
    expect_refused(file("a.vtu", vtu), 1, PLIANT_ERROR_MATERIAL,
                   {"regions without a material", "0", "labels of a material"});
    expect_refused(file("a.vtu", replaced(vtu, "vtkZLib", "vtkLZ4")), 1, PLIANT_ERROR_FORMAT, {"zlib"});
    expect_refused(file("a.vtu", replaced(vtu, "Little", "Big")), 1, PLIANT_ERROR_FORMAT, {"big-endian"});
    Tets flat = tets;
    for (int v = 0; v < 4; v++) flat.tets[static_cast<size_t>(v)] = v % 2;
    expect_refused(file("a.vtu", compressed_vtu(flat, "material")), 1, PLIANT_ERROR_FORMAT, {"tetrahedron 0 is flat"});
    flat.tets[2] = 100000;
    expect_refused(file("a.vtu", compressed_vtu(flat, "material")), 1, PLIANT_ERROR_FORMAT,
                   {"tetrahedron 0 names node 100000"});
    const std::string good = file("a.msh", text);
    expect_refused(good, 1e-3, PLIANT_ERROR_SCENE, {"mesh/file", "model/method"},
                   [](Block &block) { block.scene.model.method = PLIANT_AVERAGED; });
    expect_refused(good, 1e-3, PLIANT_ERROR_SCENE, {"mesh/file", "cut/kind"},
                   [](Block &block) { block.scene.cut.kind = PLIANT_CUT_SEVER; });
    expect_refused(good, 1e-3, PLIANT_ERROR_SCENE, {"mesh/file", "mesh/kind"},
                   [](Block &block) { block.scene.mesh.kind = PLIANT_OCTREE; });
    expect_refused(good, 1e-3, PLIANT_ERROR_SCENE, {"mesh/file", "element/kind"},
                   [](Block &block) { block.scene.element.kind = PLIANT_HEXAHEDRA; });
}

// Change, cut out and repeat bytes: every mutant is read or refused, and no memory leaks.
TEST(MeshFile, RefusesGarbage)
{
    Block lattice;
    const Tets tets = tets_of(lattice);
    temporary_folder folder;
    const std::array<std::string, 2> names{{"soft", "stiff"}};
    const pliant_body *body = pliant_model_get_body(lattice.model);
    ASSERT_EQ(pliant_mesh_save((folder / "own.vtu").c_str(), lattice.model, body, body->fine.rest, nullptr, 1),
              PLIANT_OK);
    std::ifstream own(folder / "own.vtu", std::ios::binary);
    const std::string raw{std::istreambuf_iterator<char>(own), {}};
    const struct { const char *name; std::string content;
    } files[] = {{"m.vtu", raw},
                 {"m.vtu", compressed_vtu(tets, "material")},
                 {"m.msh", msh_of(tets, false, names)},
                 {"m.msh", msh_of(tets, true, names)}};
    const size_t before = pliant_memory_in_use();
    for (const auto &file : files) {
        int refused = 0;
        std::mt19937 random(7);
        const auto below = [&](size_t limit) { return static_cast<size_t>(random() % limit); };
        for (int mutant = 0; mutant < 300; mutant++) {
            std::string content = file.content;
            // damage the header more often
            const size_t head = below(2) ? content.size() : std::min<size_t>(content.size(), 2500);
            for (size_t change = 0; change <= below(4); change++) {
                const size_t at = below(std::min(head, content.size()));
                switch (below(4)) {
                case 0: content[at] = static_cast<char>(random()); break;
                case 1: content[at] = "0123456789-\"<>=/ "[below(17)]; break;
                case 2: content.erase(at, 1 + below(40)); break;
                default: content.insert(at, content.substr(below(content.size()), below(40))); break;
                }
            }
            if (below(20) == 0) content.resize(below(content.size()) + 1);
            mesh_file read{};
            pliant_fail_quietly(true);
            const pliant_status status = pliant_mesh_file_read(written(folder, file.name, content).c_str(), 1, &read);
            pliant_fail_quietly(false);
            refused += status < 0;
            for (int32_t v = 0; v < 4 * read.num_tets; v++)
                ASSERT_LT(static_cast<uint32_t>(read.tets[v]), static_cast<uint32_t>(read.num_nodes));
            pliant_mesh_file_free(&read);
            ASSERT_EQ(pliant_memory_in_use(), before) << mutant;
        }
        EXPECT_GT(refused, 50) << file.name;
    }
}

} // namespace
