// gnathion-viewer CASE
#include <QVTKOpenGLNativeWidget.h>
#include <vtkAutoInit.h>
#include <QApplication>
#include <QSurfaceFormat>
#include <QTimer>
#include <cstdio>
#include <cstring>
#include <string>

#include "viewer/main_window.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace {

constexpr const char* kHelp =
    "gnathion-viewer CASE\n"
    "Opens a case folder: jaws in MI and in TP, the splint, its gates, and a cross-section to drag.\n"
    "Keys: 1 front, 2 left, 3 right, 4 occlusal, 5 oblique, C cross-section plane, Ctrl+S screenshot.\n"
    "Research software; it makes no clinical claim.\n";

}  // namespace

int main(int argc, char** argv) {
  for (int i = 1; i < argc; ++i)
    if (!std::strcmp(argv[i], "--help") || !std::strcmp(argv[i], "-h")) {
      std::fputs(kHelp, stdout);
      return 0;
    }
  if (argc != 2 || argv[1][0] == '-') {
    std::fputs("gnathion-viewer: wrong usage: needs one case folder: try --help\n", stderr);
    return 2;
  }
  auto scene = gnathion::open_case(argv[1]);
  if (!scene) {
    std::fprintf(stderr, "gnathion-viewer: %s\n", scene.error().line().c_str());
    return gnathion::exit_code(scene.error().code);
  }
  QSurfaceFormat format = QVTKOpenGLNativeWidget::defaultFormat();
  format.setSamples(0);
  QSurfaceFormat::setDefaultFormat(format);
  QApplication app(argc, argv);
  gnathion::MainWindow window(std::move(*scene));
  window.show();
  QTimer::singleShot(0, &window, [&window] { window.start(); });
  return app.exec();
}
