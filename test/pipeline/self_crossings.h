// Crossings of a body's surface with itself.
#ifndef PLIANT_TEST_SELF_CROSSINGS_H
#define PLIANT_TEST_SELF_CROSSINGS_H

#include "body.h"
#include "contact/advance/advance.h"
#include "contact/detect/tissue.h"

// Return the number of edges of the surface that pass through its triangles.
inline int32_t count_crossings(const Body &body)
{
    pliant_tissue tissue{};
    EXPECT_EQ(pliant_tissue_set_body(&tissue, body.data->body, nullptr, 1), PLIANT_OK);
    std::vector<int32_t> triangles;
    for (int32_t s = 0; s < tissue.num_triangles; s++)
        triangles.insert(triangles.end(), tissue.triangle[s].node, tissue.triangle[s].node + 3);
    pliant_advance *advance = nullptr;
    EXPECT_EQ(pliant_advance_create(nullptr, &advance), PLIANT_OK);
    pliant_advance_self self{};
    self.thickness = 1e-9;
    int32_t crossings = 0;
    EXPECT_EQ(pliant_advance_audit_self(advance, tissue.num_triangles, triangles.data(), body.data->positions, &self,
                                        nullptr, &crossings),
              PLIANT_OK);
    pliant_advance_free(advance);
    pliant_tissue_free(&tissue);
    return crossings;
}

#endif
