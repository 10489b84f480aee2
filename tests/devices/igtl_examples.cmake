# The OpenIGTLink library writes the messages of the igtl_* tests, and its example servers, built from the sources that
# Debian ships as documentation, are real peers. Without those sources their test says so and is skipped.
find_path(IGTL_EXAMPLES Tracker/TrackerServer.cxx PATHS /usr/share/doc/openigtlink-examples/examples NO_DEFAULT_PATH)
foreach(target devices_igtl_protocol_test devices_igtl_device_test devices_igtl_servers_test)
  if(TARGET ${target})
    target_include_directories(${target} SYSTEM PRIVATE ${OpenIGTLink_INCLUDE_DIRS})
    target_link_libraries(${target} PRIVATE ${OpenIGTLink_LIBRARIES})
  endif()
endforeach()
if(IGTL_EXAMPLES AND TARGET devices_igtl_servers_test)
  foreach(server Tracker/TrackerServer TrackingData/TrackingDataServer QuaternionTrackingData/QuaternionTrackingDataServer
      Imager/ImagerServer PolyData/PolyDataServer Status/StatusServer String/StringServer)
    get_filename_component(name ${server} NAME)
    add_executable(igtl_${name} ${IGTL_EXAMPLES}/${server}.cxx)
    set_target_properties(igtl_${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/igtl_servers)
    target_compile_options(igtl_${name} PRIVATE -w)
    target_include_directories(igtl_${name} SYSTEM PRIVATE ${OpenIGTLink_INCLUDE_DIRS})
    target_link_libraries(igtl_${name} PRIVATE ${OpenIGTLink_LIBRARIES} Threads::Threads)
    add_dependencies(devices_igtl_servers_test igtl_${name})
  endforeach()
  target_compile_definitions(devices_igtl_servers_test PRIVATE
    IGTL_SERVERS="${CMAKE_CURRENT_BINARY_DIR}/igtl_servers" IGTL_EXAMPLE_IMAGES="${IGTL_EXAMPLES}/Imager/img")
endif()
