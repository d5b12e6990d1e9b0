/* Calls functions of both C libraries. */
#include <pliant/pliant.h>
#include <pliant/report.h>

#include <stdio.h>

int main(void)
{
    const int32_t size[3] = {24, 17, 20};
    pliant_volume scan = {0};
    pliant_report_tables tables = {0};
    if (pliant_phantom(size, 1, &scan, NULL) != PLIANT_OK) {
        fprintf(stderr, "%s\n", pliant_last_error());
        return 1;
    }
    printf("Pliant %s, a scan of %d slices\n", pliant_version(), (int)scan.geometry.size[2]);
    pliant_volume_free(&scan);
    pliant_report_close(&tables);
    return 0;
}
