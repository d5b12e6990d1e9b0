# Libraries of the core: OpenMP, SuiteSparse's CHOLMOD, libcyaml, zlib, ITK.
find_package(OpenMP REQUIRED COMPONENTS C CXX)
find_package(Threads REQUIRED)
find_package(ZLIB REQUIRED)

find_path(CHOLMOD_INCLUDE_DIR cholmod.h PATH_SUFFIXES suitesparse)
find_library(CHOLMOD_LIBRARY cholmod)
find_library(SUITESPARSECONFIG_LIBRARY suitesparseconfig)
find_path(CYAML_INCLUDE_DIR cyaml/cyaml.h)
find_library(CYAML_LIBRARY cyaml)
foreach(needed CHOLMOD_INCLUDE_DIR CHOLMOD_LIBRARY SUITESPARSECONFIG_LIBRARY CYAML_INCLUDE_DIR CYAML_LIBRARY)
  if(NOT ${needed})
    message(FATAL_ERROR "${needed} not found: apt-get install libsuitesparse-dev libcyaml-dev")
  endif()
endforeach()
mark_as_advanced(CHOLMOD_INCLUDE_DIR CHOLMOD_LIBRARY SUITESPARSECONFIG_LIBRARY CYAML_INCLUDE_DIR CYAML_LIBRARY)

# ITK reports on every program of GDCM that is not installed: nothing a builder can use (quiet from cmake 3.17 on).
set(CMAKE_MESSAGE_LOG_LEVEL NOTICE)
set(pliant_itk_components ITKCommon ITKIOImageBase ITKGDCM ITKIOGDCM ITKIONIFTI ITKIONRRD ITKIOMeta ITKIOPNG)
if(PLIANT_BENCH)
  list(APPEND pliant_itk_components ITKDisplacementField)
endif()
find_package(ITK QUIET COMPONENTS ${pliant_itk_components})
# the compiler looks there anyway; named again it would hide the C++ library's own headers
list(REMOVE_ITEM ITK_INCLUDE_DIRS /usr/include)
unset(CMAKE_MESSAGE_LOG_LEVEL)
if(NOT ITK_FOUND)
  message(FATAL_ERROR
    "ITK 4.13 or 5 not found: apt-get install libinsighttoolkit5-dev (Ubuntu 20.04: libinsighttoolkit4-dev)")
endif()
