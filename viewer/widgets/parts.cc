#include "viewer/widgets/parts.h"

#include <QFileDialog>
#include <QHBoxLayout>
#include <QHeaderView>
#include <QPainter>
#include <QPainterPath>
#include <QToolButton>

#include "rendering/drawing.h"

namespace gnathion {

QColor qcolor(const Color& c) {
  return QColor::fromRgbF(c[0], c[1], c[2]);
}

QLabel* heading(const QString& text) {
  auto* label = new QLabel(text);
  label->setProperty("role", "heading");
  return label;
}

QLabel* wrapped(const QString& text, bool faint) {
  auto* label = new QLabel(text);
  label->setWordWrap(true);
  if (faint) label->setProperty("role", "faint");
  return label;
}

QPushButton* button(const QString& text, const QString& object_name, const QString& tip,
                    std::function<void()> clicked) {
  auto* b = new QPushButton(text);
  b->setObjectName(object_name);
  b->setToolTip(tip);
  QObject::connect(b, &QPushButton::clicked, b, [clicked = std::move(clicked)] { clicked(); });
  return b;
}

QTableWidget* plain_table(const QStringList& columns, const QString& object_name) {
  auto* table = new QTableWidget(0, columns.size());
  table->setObjectName(object_name);
  table->setHorizontalHeaderLabels(columns);
  table->verticalHeader()->hide();
  table->verticalHeader()->setDefaultSectionSize(22);
  table->horizontalHeader()->setMinimumSectionSize(20);
  table->setShowGrid(false);
  table->setAlternatingRowColors(true);
  table->setSelectionBehavior(QAbstractItemView::SelectRows);
  table->setSelectionMode(QAbstractItemView::SingleSelection);
  table->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  table->horizontalHeader()->setHighlightSections(false);
  return table;
}

QTableWidgetItem* cell(const QString& text, bool number) {
  auto* item = new QTableWidgetItem(text);
  item->setToolTip(text);
  if (number) item->setTextAlignment(Qt::AlignRight | Qt::AlignVCenter);
  return item;
}

QTableWidgetItem* verdict_cell(bool pass, bool blocks) {
  auto* item = new QTableWidgetItem(pass ? "✓" : blocks ? "✗" : "!");
  item->setTextAlignment(Qt::AlignCenter);
  item->setForeground(pass ? QColor(0, 110, 80) : blocks ? QColor(170, 30, 20) : QColor(150, 85, 0));
  item->setToolTip(pass ? "kept" : blocks ? "failed: decides the verdict" : "failed: a warning");
  return item;
}

QIcon eye_icon(bool open) {
  QPixmap map(40, 40);
  map.fill(Qt::transparent);
  QPainter p(&map);
  p.setRenderHint(QPainter::Antialiasing);
  const QColor ink = open ? QColor(28, 36, 48) : QColor(150, 156, 166);
  p.setPen(QPen(ink, 3));
  QPainterPath lid(QPointF(3, 20));
  lid.quadTo(20, 4, 37, 20);
  lid.quadTo(20, 36, 3, 20);
  if (open) {
    p.drawPath(lid);
    p.setBrush(ink);
    p.drawEllipse(QPointF(20, 20), 6, 6);
  } else {
    QPainterPath closed(QPointF(3, 18));
    closed.quadTo(20, 32, 37, 18);
    p.drawPath(closed);
  }
  return QIcon(map);
}

StepStatus::StepStatus(const QString& object_name) {
  setObjectName(object_name);
  setProperty("role", "status");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(8, 6, 8, 6);
  text_ = new QLabel;
  text_->setObjectName(object_name + "Text");
  text_->setWordWrap(true);
  text_->setTextFormat(Qt::RichText);
  column->addWidget(text_);
}

/// A long name breaks at its commas and strokes: it must not widen the panel.
static QString breakable(const std::string& text) {
  return QString::fromStdString(text).toHtmlEscaped().replace(QRegExp("([,/_])(?=\\S)"), "\\1\u200b");
}

void StepStatus::show_state(const QStringList& done, const std::vector<Absence>& missing) {
  QStringList lines;
  for (const QString& line : done) lines << "<span style='color:#00694d'>✓</span> " + line;
  for (const Absence& a : missing)
    lines << QString("<span style='color:%1'>%2 <b>%3</b></span>: %4")
                 .arg(a.broken ? "#a01e14" : "#7a4600", a.broken ? "✗" : "○",
                      QString::fromStdString(a.what).toHtmlEscaped(), breakable(a.why));
  text_->setText(lines.join("<br>"));
  setVisible(!lines.isEmpty());
}

MessageBar::MessageBar(QWidget* parent) : QFrame(parent) {
  setObjectName("messageBar");
  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(12, 4, 6, 4);
  label_ = new QLabel;
  label_->setObjectName("messageText");
  label_->setWordWrap(true);
  label_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  auto* close = new QToolButton;
  close->setText("✕");
  close->setObjectName("messageClose");
  close->setAutoRaise(true);
  connect(close, &QToolButton::clicked, this, &QWidget::hide);
  row->addWidget(label_, 1);
  row->addWidget(close);
  hide();
}

void MessageBar::show_line(const QString& line, const char* style) {
  label_->setText(line);
  setStyleSheet(style);
  show();
}

void MessageBar::show_error(const QString& line) {
  show_line(line,
            "#messageBar{background:#fbe6e3;border-bottom:1px solid #c4483a}"
            "#messageText{color:#7c1a10;font-weight:600}");
}

void MessageBar::show_notice(const QString& line) {
  show_line(line,
            "#messageBar{background:#e6f0fa;border-bottom:1px solid #6f9cc9}"
            "#messageText{color:#123e68}");
}

ChartView::ChartView(QWidget* parent) : QWidget(parent) {
  setMinimumSize(200, 120);
  setToolTip("Click: large");
}

void ChartView::mousePressEvent(QMouseEvent*) {
  if (is_large_)
    hide();
  else if (drawing_)
    enlarge();
}

void ChartView::enlarge() {
  if (!large_) {
    large_ = new ChartView(window());
    large_->setObjectName("largeChart");
    large_->is_large_ = true;
  }
  large_->set_drawing(drawing_);
  const int w = window()->width(), h = window()->height();
  large_->setGeometry(w / 20, h / 12, w - w / 10, h - h / 6);
  large_->show();
  large_->raise();
}

void ChartView::set_drawing(std::shared_ptr<const Drawing> drawing) {
  drawing_ = std::move(drawing);
  picture_ = {};
  update();
}

void ChartView::set_note(const QString& note) {
  note_ = note;
  drawing_.reset();
  picture_ = {};
  update();
}

void ChartView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), Qt::white);
  if (!drawing_) {
    painter.setPen(QColor(96, 103, 116));
    painter.drawText(rect().adjusted(24, 12, -24, -12), Qt::AlignCenter | Qt::TextWordWrap, note_);
    return;
  }
  const double frame = is_large_ ? 24 : 0;
  const double fit =
      std::min((width() - frame) / drawing_->width_pt(), (height() - frame) / drawing_->height_pt());
  const double ratio = devicePixelRatioF();
  if (picture_.isNull() || drawn_for_ != size()) {
    if (const Result<std::string> png = png_bytes(*drawing_, fit * ratio))
      picture_.loadFromData(reinterpret_cast<const uchar*>(png->data()), static_cast<int>(png->size()));
    drawn_for_ = size();
  }
  const QSizeF shown(drawing_->width_pt() * fit, drawing_->height_pt() * fit);
  painter.setRenderHint(QPainter::SmoothPixmapTransform);
  painter.drawImage(QRectF(QPointF((width() - shown.width()) / 2, (height() - shown.height()) / 2), shown),
                    picture_);
  painter.setPen(QColor(96, 103, 116));
  if (is_large_) return painter.drawRect(rect().adjusted(0, 0, -1, -1));
  painter.setFont(QFont(font().family(), 8));
  painter.drawText(rect().adjusted(0, 0, -6, -4), Qt::AlignRight | Qt::AlignBottom, "click: large");
}

void choose_file(QWidget* parent, const QString& title, const QString& folder, const QString& filter,
                 std::function<void(const QString&)> chosen) {
  auto* dialog = new QFileDialog(parent, title, folder, filter);
  dialog->setObjectName("fileDialog");
  dialog->setOption(QFileDialog::DontUseNativeDialog);
  dialog->setFileMode(QFileDialog::ExistingFile);
  dialog->setAttribute(Qt::WA_DeleteOnClose);
  QObject::connect(dialog, &QFileDialog::fileSelected, parent, std::move(chosen));
  dialog->open();
}

}  // namespace gnathion
