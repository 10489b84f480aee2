// gnathion-viewer [CASE] [--socket PATH] [--step N]
#include <QVTKOpenGLNativeWidget.h>
#include <vtkAutoInit.h>
#include <QApplication>
#include <QSurfaceFormat>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "viewer/main_window.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace {

constexpr const char* kHelp =
    "gnathion-viewer [CASE] [--socket PATH]\n"
    "The whole method in one window: Capture, Motion, Calibrate, Transformation, Design, Evaluate.\n"
    "CASE           a case folder; files that are missing or broken are told in the window\n"
    "--socket PATH  the daemon's socket (default: $GNATHION_SOCKET, or /run/gnathion/gnathiond.sock)\n"
    "F1 in the window lists mouse and keys. Research software; it makes no clinical claim.\n";

int wrong_usage(const std::string& why) {
  std::fprintf(stderr, "gnathion-viewer: wrong usage: %s: try --help\n", why.c_str());
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  gnathion::WindowOptions options;
  std::string folder;
  if (const char* socket = std::getenv("GNATHION_SOCKET")) options.socket = socket;
  for (int i = 1; i < argc; ++i) {
    const std::string arg = argv[i];
    if (arg == "--help" || arg == "-h") {
      std::fputs(kHelp, stdout);
      return 0;
    }
    if (arg == "--socket") {
      if (++i == argc) return wrong_usage("--socket needs a path");
      options.socket = argv[i];
    } else if (arg[0] == '-') {
      return wrong_usage("unknown option " + arg);
    } else if (folder.empty()) {
      folder = arg;
    } else {
      return wrong_usage("one case folder only");
    }
  }
#ifdef GNATHION_HAS_CLIENT
  options.connect = [](const std::string& socket) { return gnathion::client::DaemonClient::connect(socket); };
#endif
  QCoreApplication::setAttribute(Qt::AA_EnableHighDpiScaling);
  QCoreApplication::setAttribute(Qt::AA_UseHighDpiPixmaps);
  QSurfaceFormat format = QVTKOpenGLNativeWidget::defaultFormat();
  format.setSamples(0);
  QSurfaceFormat::setDefaultFormat(format);
  QApplication app(argc, argv);
  gnathion::MainWindow window(std::move(options));
  window.show();
  if (!folder.empty()) window.open(folder);
  return app.exec();
}
