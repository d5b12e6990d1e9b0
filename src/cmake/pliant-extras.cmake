# The targets pliant::pliant and pliant::report, in a catkin workspace as elsewhere. Packages that catkin_make
# configures together with Pliant have them already: the file is written after all packages are configured.
if(NOT TARGET pliant::pliant)
  include(${pliant_DIR}/pliant-targets.cmake)
endif()
