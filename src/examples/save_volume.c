/* How do I save the deformed scan as a file?    save_volume OUT.nii.gz */
#include "example.h"

int main(int argc, char **argv)
{
    const double point[3] = {0.05, -0.09, 0.06}, tip[3] = {0.05, -0.11, 0.06};
    const char *path = argc > 1 ? argv[1] : "deformed.nii.gz";
    example all;
    int tool;
    pliant_status status = example_begin(NULL, &all);
    if (status >= 0) {
        /* the scan's grid, extended by 3 cm on every side */
        pliant_geometry target;
        const pliant_mesh *mesh = &pliant_model_get_body(all.model)->fine;
        status = pliant_warp_target(&all.scan.geometry, mesh->rest, mesh->num_nodes, 0.03, SIZE_MAX, &target);
        /* each following step deforms the volume */
        if (status >= 0) status = pliant_data_set_warp(all.model, all.data, &target);
    }
    if (status >= 0) status = example_hold(&all, all.data, point, &tool);
    if (status >= 0) status = pliant_tool_set_pose(all.data, tool, tip, NULL);
    for (int step = 0; step < 10 && status >= 0; step++) status = pliant_step(all.model, all.data);
    if (status >= 0) status = pliant_volume_write(path, pliant_warp_volume(pliant_data_get_warp(all.data)));
    if (status >= 0) printf("%s\n", path);
    return example_end(&all, status);
}
