/* Synthetic segmentations: .seg.nrrd as 3D Slicer writes it, and DICOM SEG. */
#ifndef PLIANT_TEST_SEGMENTATION_FILES_H
#define PLIANT_TEST_SEGMENTATION_FILES_H

#include "scan_files.h"


/* A .seg.nrrd of 3 x 4 x 2 voxels. Fields are written unchanged, and "" leaves a field out. */
struct seg_nrrd_file {
    struct segment {
        std::string name, identifier, value, layer, color, tags;
    };
    std::vector<segment> segments;
    size_t layers = 1;
    bool layers_first = true, compressed = false;
    std::string type = "unsigned char", origin = "(0,0,0)", more;
    std::vector<uint8_t> voxels; /* (24, layers), layer fastest if layers_first */

    std::string bytes() const
    {
        const std::string space = "(0.5,0,0) (0,0.5,0) (0,0,2)", size = "3 4 2", count = std::to_string(layers);
        auto with_layers = [&](const std::string &layer, const std::string &rest) {
            return layers == 1 ? rest : layers_first ? layer + " " + rest : rest + " " + layer;
        };
        std::string out = "NRRD0004\n# Complete NRRD file format specification at:\ntype: " + type +
                          "\ndimension: " + (layers == 1 ? "3" : "4") +
                          "\nspace: left-posterior-superior\nsizes: " + with_layers(count, size) +
                          "\nspace directions: " + with_layers("none", space) +
                          "\nkinds: " + with_layers("list", "domain domain domain") +
                          "\nendian: little\nencoding: " + (compressed ? "gzip" : "raw") + "\nspace origin: " + origin +
                          "\n" + more;
        for (size_t n = 0; n < segments.size(); n++) {
            auto add = [&](const std::string &field, const std::string &value) {
                if (!value.empty()) out += "Segment" + std::to_string(n) + "_" + field + ":=" + value + "\n";
            };
            add("Color", segments[n].color);
            add("Extent", "0 2 0 3 0 1");
            add("ID", segments[n].identifier);
            add("LabelValue", segments[n].value);
            add("Layer", segments[n].layer);
            add("Name", segments[n].name);
            add("Tags", segments[n].tags);
        }
        const std::string data(voxels.begin(), voxels.end());
        return out + "Segmentation_MasterRepresentation:=Binary labelmap\n\n" +
               (compressed ? deflated(data, MAX_WBITS + 16) : data);
    }
    std::vector<size_t> at(size_t voxel, size_t layer) const
    {
        return {layers_first ? voxel * layers + layer : voxel + 24 * layer};
    }
    void set(size_t voxel, size_t layer, uint8_t value)
    {
        voxels.resize(24 * layers);
        voxels[at(voxel, layer)[0]] = value;
    }
};

inline std::string terminology(const std::string &type, const std::string &modifier = "^^")
{
    return "Segmentation.Status:inprogress|TerminologyEntry:Segmentation category and type - 3D Slicer General Anatomy "
           "list~SCT^123037004^Anatomical Structure~" +
           type + "~" + modifier + "~Anatomic codes - DICOM master list~^^~^^|";
}

/* A DICOM SEG of 5 x 3 voxels a slice, slices 2 mm apart along z. Sequences have lengths or end delimiters. */
struct dicom_seg_file {
    struct segment {
        uint16_t number;
        std::string label, meaning;
        std::vector<uint16_t> color;
    };
    struct frame {
        uint16_t segment;
        std::string position;
        std::vector<uint16_t> voxels; /* 15 */
    };
    std::vector<segment> segments;
    std::vector<frame> frames;
    std::string uid = "1.2.840.10008.5.1.4.1.1.66.4", kind = "BINARY", spacing = "0.5\\0.5", between = "2",
                thickness = "2";
    std::string syntax = "1.2.840.10008.1.2.1";
    uint16_t bits = 1, rows = 3, columns = 5, maximum = 255;
    bool marks = false, has_groups = true;
    std::vector<std::string> images; /* compressed frames, of even lengths */

    static std::string words(std::initializer_list<uint32_t> values) { return bytes_of(std::vector<uint32_t>(values)); }
    static std::string element(uint32_t tag, const std::string &type, std::string value)
    {
        const uint16_t halves[2] = {uint16_t(tag >> 16), uint16_t(tag)};
        if (value.size() % 2) value += type == "UI" ? '\0' : ' ';
        std::string head = std::string(reinterpret_cast<const char *>(halves), 4) + type;
        if (type == "SQ" || type == "OB" || type == "OW")
            return head + std::string(2, '\0') + words({uint32_t(value.size())}) + value;
        return head + bytes_of(std::vector<uint16_t>{uint16_t(value.size())}) + value;
    }
    static std::string number(uint16_t value) { return bytes_of(std::vector<uint16_t>{value}); }
    std::string item(const std::string &value) const
    {
        const std::string start("\xfe\xff\x00\xe0", 4), end("\xfe\xff\x0d\xe0", 4);
        return marks ? start + words({0xffffffff}) + value + end + words({0})
                     : start + words({uint32_t(value.size())}) + value;
    }
    std::string sequence(uint32_t tag, const std::string &items) const
    {
        if (!marks) return element(tag, "SQ", items);
        return element(tag, "SQ", "").substr(0, 8) + words({0xffffffff}) + items + std::string("\xfe\xff\xdd\xe0", 4) +
               words({0});
    }
    std::string pixels() const
    {
        std::string out;
        size_t bit = 0;
        for (const frame &one : frames)
            for (uint16_t value : one.voxels) {
                if (bits == 8) out += char(value);
                else if (bits == 16) out += number(value);
                else {
                    if (bit % 8 == 0) out += '\0';
                    if (value) out.back() = char(out.back() | 1 << bit % 8);
                    bit++;
                }
            }
        if (!images.empty()) {
            const std::string start("\xfe\xff\x00\xe0", 4);
            std::string fragments = start + words({0});
            for (const std::string &image : images) fragments += start + words({uint32_t(image.size())}) + image;
            return element(0x7fe00010, "OB", "").substr(0, 8) + words({0xffffffff}) + fragments +
                   std::string("\xfe\xff\xdd\xe0", 4) + words({0});
        }
        return element(0x7fe00010, bits == 16 ? "OW" : "OB", out.size() % 2 ? out + '\0' : out);
    }
    std::string bytes() const
    {
        const std::string meta = element(0x00020002, "UI", uid) + element(0x00020010, "UI", syntax);
        std::string out =
            std::string(128, '\0') + "DICM" + element(0x00020000, "UL", words({uint32_t(meta.size())})) + meta;
        out += element(0x00080016, "UI", uid) + element(0x00080060, "CS", "SEG") +
               element(0x0020000e, "UI", "1.2.3.9") + element(0x00280002, "US", number(1)) +
               element(0x00280004, "CS", "MONOCHROME2") + element(0x00280008, "IS", std::to_string(frames.size())) +
               element(0x00280010, "US", number(rows)) + element(0x00280011, "US", number(columns)) +
               element(0x00280100, "US", number(bits)) + element(0x00280101, "US", number(bits)) +
               element(0x00280102, "US", number(uint16_t(bits - 1))) + element(0x00280103, "US", number(0)) +
               element(0x00620001, "CS", kind);
        std::string items, groups;
        for (const segment &one : segments) {
            const std::string type = one.meaning.empty()
                                         ? ""
                                         : sequence(0x0062000f, item(element(0x00080100, "SH", "1") +
                                                                     element(0x00080104, "LO", one.meaning)));
            const std::string color = one.color.empty() ? "" : element(0x0062000d, "US", bytes_of(one.color));
            items += item(element(0x00620004, "US", number(one.number)) + element(0x00620005, "LO", one.label) + color +
                          type);
        }
        if (!segments.empty()) out += sequence(0x00620002, items);
        if (kind == "FRACTIONAL") out += element(0x0062000e, "US", number(maximum));
        if (!has_groups) return out + pixels();
        const std::string measures = element(0x00180050, "DS", thickness) +
                                     (between.empty() ? "" : element(0x00180088, "DS", between)) +
                                     element(0x00280030, "DS", spacing);
        out += sequence(0x52009229, item(sequence(0x00209116, item(element(0x00200037, "DS", "1\\0\\0\\0\\1\\0"))) +
                                         sequence(0x00289110, item(measures))));
        for (const frame &one : frames)
            groups += item(
                sequence(0x00209113, item(element(0x00200032, "DS", one.position))) +
                (kind == "LABELMAP" ? "" : sequence(0x0062000a, item(element(0x0062000b, "US", number(one.segment))))));
        return out + sequence(0x52009230, groups) + pixels();
    }
    void add_frame(uint16_t of, int slice, std::initializer_list<size_t> set, uint16_t value = 1)
    {
        frame one = {of, "10\\20\\" + std::to_string(30 + 2 * slice), std::vector<uint16_t>(15, 0)};
        for (size_t n : set) one.voxels[n] = value;
        frames.push_back(one);
    }
};

#endif
