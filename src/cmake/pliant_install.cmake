# Headers, launch files, scenes and materials; and a package that find_package(pliant) finds.
# Libraries and programs are installed where they are declared.
set(package_dir share/pliant/cmake)
if(PLIANT_WITH_ROS)
  if(NOT PLIANT_MSGS_ONLY)
    export(EXPORT pliant-targets NAMESPACE pliant:: FILE ${CATKIN_DEVEL_PREFIX}/share/pliant/cmake/pliant-targets.cmake)
    # pliant_core: the core alone, for users without the ROS packages that catkin's pliantConfig.cmake needs
    file(WRITE ${PROJECT_BINARY_DIR}/pliant_coreConfig.cmake
         "include(\${CMAKE_CURRENT_LIST_DIR}/../../pliant/cmake/pliant-targets.cmake)\n")
    install(FILES ${PROJECT_BINARY_DIR}/pliant_coreConfig.cmake DESTINATION share/pliant_core/cmake)
    # where package.xml names them, in the source tree as installed
    install(FILES src/ros/node/nodelets.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION}/src/ros/node)
    if(PLIANT_WITH_RVIZ)
      install(FILES src/rviz/plugins.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION}/src/rviz)
    endif()
  endif()
else()
  #catkin_lint: skip (without ROS this is no catkin package)
  include(CMakePackageConfigHelpers)
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/pliantConfigVersion.cmake COMPATIBILITY SameMinorVersion)
  file(WRITE ${PROJECT_BINARY_DIR}/pliantConfig.cmake "include(\${CMAKE_CURRENT_LIST_DIR}/pliant-targets.cmake)\n")
  export(EXPORT pliant-targets NAMESPACE pliant:: FILE ${PROJECT_BINARY_DIR}/pliant-targets.cmake)
  install(FILES ${PROJECT_BINARY_DIR}/pliantConfig.cmake ${PROJECT_BINARY_DIR}/pliantConfigVersion.cmake
          DESTINATION ${package_dir})
  # for builders without CMake; where ROS is, catkin makes a file of this name
  configure_file(src/cmake/pliant.pc.in ${PROJECT_BINARY_DIR}/pliant.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/pliant.pc DESTINATION ${PLIANT_LIB_DIR}/pkgconfig)
endif()
if(NOT PLIANT_MSGS_ONLY)
  install(EXPORT pliant-targets NAMESPACE pliant:: DESTINATION ${package_dir})
  install(DIRECTORY include/pliant DESTINATION ${PLIANT_INCLUDE_DIR} FILES_MATCHING PATTERN "*.h" PATTERN ros EXCLUDE)
  if(PLIANT_WITH_ROS)
    install(DIRECTORY include/pliant/ros DESTINATION ${PLIANT_INCLUDE_DIR}/pliant FILES_MATCHING PATTERN "*.h")
  endif()
  install(DIRECTORY launch/ DESTINATION ${PLIANT_SHARE_DIR}/launch USE_SOURCE_PERMISSIONS
          FILES_MATCHING PATTERN "*.launch" PATTERN "*.yaml" PATTERN "*.rviz" PATTERN "*.py")
endif()
# Install pliant.py and its modules. With ROS they belong to the messages' package, which imports them on first use.
set(python_modules pliant_library.py pliant_results.py pliant_tool.py)
if(PLIANT_WITH_ROS AND NOT PLIANT_MSGS_ONLY)
  configure_file(src/python/package.py ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION}/pliant/__init__.py
    COPYONLY)
  configure_file(src/python/pliant.py ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION}/pliant/simulation.py
    COPYONLY)
  install(FILES src/python/package.py DESTINATION ${CATKIN_GLOBAL_PYTHON_DESTINATION}/pliant RENAME __init__.py)
  install(FILES src/python/pliant.py DESTINATION ${CATKIN_GLOBAL_PYTHON_DESTINATION}/pliant RENAME simulation.py)
  foreach(module ${python_modules})
    configure_file(src/python/${module} ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION}/pliant/${module}
      COPYONLY)
    install(FILES src/python/${module} DESTINATION ${CATKIN_GLOBAL_PYTHON_DESTINATION}/pliant)
  endforeach()
  # in the folder of pliant_bag, which runs it
  configure_file(src/python/lerobot.py ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_BIN_DESTINATION}/pliant_lerobot COPYONLY)
  pliant_link_command(pliant_lerobot)
  foreach(folder ${PLIANT_BIN_DIR} ${CATKIN_PACKAGE_BIN_DESTINATION})
    install(PROGRAMS src/python/lerobot.py DESTINATION ${folder} RENAME pliant_lerobot)
  endforeach()
elseif(NOT PLIANT_WITH_ROS)
  list(TRANSFORM python_modules PREPEND src/python/)
  install(FILES src/python/pliant.py ${python_modules} DESTINATION ${PLIANT_LIB_DIR}/python3/dist-packages)
endif()
install(FILES LICENSE README.md DESTINATION ${PLIANT_SHARE_DIR})
# documents and pictures at their paths in the source tree, so that links between them also work after installation
file(GLOB_RECURSE documents RELATIVE ${PROJECT_SOURCE_DIR} src/*.md launch/*.md launch/*.png)
foreach(document ${documents})
  get_filename_component(folder ${document} DIRECTORY)
  install(FILES ${document} DESTINATION ${PLIANT_SHARE_DIR}/${folder})
endforeach()
# plugins that are not installed are not named: in place of the package.xml that catkin has installed
if(PLIANT_WITH_ROS AND NOT PLIANT_WITH_RVIZ)
  file(READ package.xml package)
  string(REGEX REPLACE "\n *<rviz plugin[^\n]*" "" package "${package}")
  if(PLIANT_MSGS_ONLY)
    string(REGEX REPLACE "\n *<nodelet plugin[^\n]*" "" package "${package}")
  endif()
  file(WRITE ${PROJECT_BINARY_DIR}/package.xml "${package}")
  install(FILES ${PROJECT_BINARY_DIR}/package.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
endif()
