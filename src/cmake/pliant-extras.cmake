# find_package(pliant) also gives the target pliant::pliant, in a catkin workspace as elsewhere.
if(NOT TARGET pliant::pliant)
  include(${pliant_DIR}/pliant-targets.cmake)
endif()
