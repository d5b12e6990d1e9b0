/** @file pliant.h
 *  Living tissue from a CT or MRI scan.
 *
 *      scan -> material -> mesh -> homogenize -> MODEL (constant)
 *                                                  |
 *      tool poses -> interact -> solve -> upsample -> DATA (mutable) -> warp -> deformed volume
 *
 *  Conventions, stated once:
 *  - Units are SI: metres, kilograms, seconds, newtons, pascals. Millimetres and Hounsfield units stop at the loaders
 *    (a CT's stored values stay Hounsfield units).
 *  - Frames are right-handed; world is the patient's LPS axes (x left, y posterior, z superior), in metres.
 *  - Volumes are flat, i fastest; meshes are flat arrays, three or four numbers a row.
 *  - Matrices are row-major.
 *  - Order of parameters: constant input, in/out, output last. Whoever creates frees.
 *  - Functions return pliant_status (status.h); on failure their outputs are untouched.
 *  - double where something is factorized, float where it is streamed.
 *  - The same input, backend and number of threads give the same bits.
 *  - [H] is the paper on heterogeneous volume deformation (homogenized corotational FEM), [C] the one on volumetric image manipulation
 *    for patient-specific deformation and cutting (V-GMM, octree proxy, TLED, fitting).
 *  - A model may be shared by threads; a data belongs to one at a time.
 */
#ifndef PLIANT_PLIANT_H
#define PLIANT_PLIANT_H

#include "pliant/version.h"
#include "pliant/status.h"
#include "pliant/open.h"
#include "pliant/scan.h"
#include "pliant/segment.h"
#include "pliant/material.h"
#include "pliant/mesh.h"
#include "pliant/body.h"
#include "pliant/cut.h"
#include "pliant/scene.h"
#include "pliant/model.h"
#include "pliant/warp.h"
#include "pliant/displacement.h"
#include "pliant/save.h"
#include "pliant/data.h"
#include "pliant/state.h"
#include "pliant/render.h"
#include "pliant/solid.h"
#include "pliant/contact.h"
#include "pliant/pick.h"
#include "pliant/report.h"

#endif
