/* GPU search for contacts of tissue on tissue (contact/detect/tissue.h). */
#ifndef PLIANT_CUDA_TISSUE_H
#define PLIANT_CUDA_TISSUE_H

#include "contact/detect/tissue.h"

#ifdef __cplusplus
extern "C" {
#endif

extern const pliant_tissue_searcher pliant_cuda_tissue_searcher;

#ifdef __cplusplus
}
#endif
#endif
