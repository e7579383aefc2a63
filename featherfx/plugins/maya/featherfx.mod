+ featherfx @VERSION@ @FOLDER@
PYTHONPATH +:= .
PYTHONPATH +:= scripts
