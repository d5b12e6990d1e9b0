# Tests of the rviz displays: code without rviz with gtest; images with rviz under Xvfb with software rendering.
foreach(name rviz_image_test rviz_slices_test rviz_transfer_test rviz_mesh_test)
  add_executable(${name} ${CMAKE_CURRENT_LIST_DIR}/${name}.cpp)
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/include)
  target_link_libraries(${name} PRIVATE pliant_rviz_plain GTest::gtest GTest::gtest_main Threads::Threads)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT 120)
endforeach()

# rviz that reports the screen positions of its rows, for tests that click
add_executable(rviz_rows ${CMAKE_CURRENT_LIST_DIR}/rviz_rows.cpp)
target_compile_options(rviz_rows PRIVATE -Wall -Wextra)
target_include_directories(rviz_rows SYSTEM PRIVATE ${catkin_INCLUDE_DIRS} ${rviz_INCLUDE_DIRS})
target_link_libraries(rviz_rows PRIVATE ${catkin_LIBRARIES} ${rviz_LIBRARIES} Qt5::Widgets)
set_target_properties(rviz_rows PROPERTIES
  RUNTIME_OUTPUT_DIRECTORY ${CATKIN_DEVEL_PREFIX}/${CATKIN_PACKAGE_BIN_DESTINATION})

# exit code 77: skipped, with the reason. One of them runs at a time, so they start early.
foreach(name rviz_pictures_test rviz_views_test rviz_pull_test rviz_cut_test)
  add_test(NAME ${name} COMMAND ${CMAKE_COMMAND} -E env PLIANT_SETUP=${CATKIN_DEVEL_PREFIX}/setup.bash
                                ${CMAKE_CURRENT_LIST_DIR}/rviz_run ${CMAKE_CURRENT_LIST_DIR}/${name}.py)
  set_tests_properties(${name} PROPERTIES TIMEOUT 400 SKIP_RETURN_CODE 77 RESOURCE_LOCK rviz COST 200
                       ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1;OMP_WAIT_POLICY=passive")
endforeach()
