// A bar of two materials that cuts sever.
#ifndef PLIANT_TEST_SEVERED_BAR_H
#define PLIANT_TEST_SEVERED_BAR_H

#include "cuts.h"

static const int size[3] = {40, 20, 20};
static const double box[3] = {0.2, 0.1, 0.1};

inline std::unique_ptr<CutState> bar(const std::function<void(pliant_scene &)> &set = [](pliant_scene &) {})
{
    std::unique_ptr<Body> body(new Body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.3, 1200, false}},
                                        [](int i, int j, int k) { return (i / 5 + j / 4 + k / 3) % 2; }));
    body->fix_plane(1e-6, 0, 0, 1, 0, 0);
    body->cells(8, 4, 4, 1);
    body->scene.cut.kind = PLIANT_CUT_SEVER;
    set(body->scene);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return std::unique_ptr<CutState>(new CutState(std::move(body)));
}

#endif
