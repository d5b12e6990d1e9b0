/* The parts of a division. */
#ifndef PLIANT_BODY_DIVIDE_H
#define PLIANT_BODY_DIVIDE_H

#include "pliant/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- copy.c: a list with count elements at first, made longer; copies of the elements that source (those appended) names */
pliant_status pliant_body_append(void *list, size_t size, int32_t count, int32_t appended, const int32_t *source);
/* likewise: the parents; a list that is NULL is made first */
pliant_status pliant_body_append_parents(int32_t **parent, int32_t count, int32_t appended, const int32_t *source);

/* ---- nest.c: the coarse mesh of next, which has that of the body before, divided where its fine tetrahedra are */
pliant_status pliant_body_nest(const pliant_body *before, pliant_body *next);

#ifdef __cplusplus
}
#endif
#endif
