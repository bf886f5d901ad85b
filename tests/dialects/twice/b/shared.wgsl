#define_import_path own::shared

const VERSION: f32 = 2.0;
